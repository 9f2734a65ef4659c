// Tables of a request's members (api/schema/members.h). A row is m.add(name in JSON, field of the C++ struct, kind,
// meaning); the kind gives type, range and unit. Rules across members, checks and conversions follow the rows.
#include "api/requests/parts/band_json.h"

#include <fmt/format.h>

#include "api/json/ranges.h"
#include "api/schema/member_kinds.h"
#include "dem/base/error.h"

namespace selenograph::api {
namespace {

using engine::Band;

std::optional<Band> resolve_band(const JsonReader& in, const BandForm& form, const ReadContext&) {
  // The upper end of a rectangle is not a member with a range of its own. Band() checks its lower end.
  if (!form.response && !kWavelength_um.contains(*form.center_um + *form.width_um / 2)) {
    in.fail("width_um", fmt::format("the band must end at {} um or before", kWavelength_um.max));
    return std::nullopt;
  }
  try {
    return form.response ? Band(*form.response) : Band(*form.center_um, *form.width_um);
  } catch (const ImpossibleRequest& e) {
    in.fail(form.response ? "response" : "width_um", e.what());
    return std::nullopt;
  }
}

}  // namespace

const Members<BandForm, Band>& band_members() {
  static const auto table = make_table<Members<BandForm, Band>>(
      "Band",
      "The spectral channel that radiance is integrated over: center and width, or a response curve. Left out: all "
      "wavelengths.",
      [](auto& m) {
        m.add("center_um", &BandForm::center_um, Number{kWavelength_um, "um"},
              "center of a band of response 1 that is width_um wide");
        m.add("width_um", &BandForm::width_um, Number{kWavelength_um, "um"},
              "width of the band, below twice the center");
        m.add("response", &BandForm::response,
              List{Pair<engine::ResponsePoint>{kWavelength_um, kUnitInterval}, 2, 10000},
              "[wavelength in um, response] at rising wavelengths; linear in between, 0 outside");
        m.exactly_one({"center_um", "response"});
        m.needs("center_um", {"width_um"});
        m.excludes("response", {"width_um"}, "that belongs to \"center_um\"");
        m.resolve(resolve_band);
        m.unresolve([](const Band& band) { return BandForm{{}, {}, band.response()}; });
      });
  return *table;
}

}  // namespace selenograph::api
