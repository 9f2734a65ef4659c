// Tables of a request's members (api/schema/members.h). A row is m.add(name in JSON, field of the C++ struct, kind,
// meaning); the kind gives type, range and unit. Rules across members, checks and conversions follow the rows.
#include "api/requests/parts/truth_json.h"

#include "api/json/ranges.h"
#include "api/requests/parts/region_json.h"
#include "api/schema/member_kinds.h"

namespace selenograph::api {
namespace {

constexpr std::pair<std::string_view, engine::TruthGrid::Floats> kFloats[] = {
    {"float64", engine::TruthGrid::Floats::float64},
    {"float32", engine::TruthGrid::Floats::float32},
    {"float16", engine::TruthGrid::Floats::float16}};

const auto region_field =
    Property{[](const engine::TruthGrid& t) { return std::optional<engine::ImageRegion>(t); },
             [](engine::TruthGrid& t, const engine::ImageRegion& r) { static_cast<engine::ImageRegion&>(t) = r; }};

}  // namespace

const Members<engine::TruthGrid>& truth_members() {
  using engine::TruthGrid;
  static const auto table = make_table<Members<TruthGrid>>(
      "Truth",
      "Subset of pixels for ground-truth products: all except image and radiance, which stay whole. Element (r, c) of "
      "their arrays belongs to the image's pixel in row y + r * every_px and column x + c * every_px.",
      [](auto& m) {
        m.add("region", region_field, Object{region_members()}, "left out: the whole image");
        m.add("every_px", &TruthGrid::every_px, Integer{1, largest_side, "px"},
              "every n-th row and column of the region, from its first");
        m.add("position_origin_m", &TruthGrid::position_origin_m, Vector{kCoordinate_m, "m"},
              "MOON_ME, whatever the pose's frame: `position` is relative to it, as float32 (accurate to 6e-8 of the "
              "distance: 1 mm at 17 km); left out: absolute, as float64");
        m.add("distance_type", &TruthGrid::distances, Word{kFloats},
              "type of `depth` and `range`: float32 is accurate to 6e-8 of the distance, float16 to 5e-4, and infinite "
              "from 65 520 m on");
      });
  return *table;
}

void resolve_truth(const JsonReader& in, const engine::Camera& camera, engine::TruthGrid& truth) {
  if (truth.width > 0) return check_region(in.at("truth"), truth, camera);
  truth.width = camera.width;
  truth.height = camera.height;
}

}  // namespace selenograph::api
