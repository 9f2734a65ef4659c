#include "api/mertis_json.h"

#include <fmt/format.h>

#include <algorithm>

#include "api/ranges.h"
#include "dem/error.h"

namespace selenograph::api {
namespace {

using engine::SpectrometerChannel;
using OrderedJson = nlohmann::ordered_json;

constexpr Range kPitch_um{0, 1e4, true, false};
constexpr Range kPower_w{0, 1, true, false};
constexpr Range kBlackbody_k{1, 1e4};

void read_efficiency(const JsonReader& in, engine::Spectrometer& s) {
  if (in.value().is_number()) {
    const double eta = in.number(kUnitInterval);
    s.efficiency = {{s.first_um, eta}};
    return;
  }
  s.efficiency.clear();
  in.elements(1, 1000, [&](const JsonReader& point) {
    const auto p = point.pair(kWavelength_um, kUnitInterval);
    if (!p) return;
    if (!s.efficiency.empty() && !(p->first > s.efficiency.back().wavelength_um)) point.fail("wavelengths must rise");
    s.efficiency.push_back({p->first, p->second});
  });
}

MertisQuery read_members(const JsonReader& in) {
  MertisQuery query;
  engine::Spectrometer& s = query.spectrometer;
  if (!in.object({"description", "first_um", "last_um", "channels", "pixel_pitch_um", "f_number", "efficiency",
                  "noise_equivalent_power_w", "temperatures_k"}))
    return query;
  if (in.has("description")) in.at("description").text();
  s.first_um = in.number("first_um", kWavelength_um, s.first_um);
  s.last_um = in.number("last_um", kWavelength_um, s.last_um);
  if (!(s.last_um > s.first_um)) in.fail("last_um", "must be above first_um");
  s.channels = static_cast<int>(in.integer("channels", 1, kMaxChannels, s.channels));
  s.pixel_pitch_um = in.number("pixel_pitch_um", kPitch_um, s.pixel_pitch_um);
  s.f_number = in.number("f_number", kFNumber, s.f_number);
  if (in.has("efficiency")) read_efficiency(in.at("efficiency"), s);
  s.noise_equivalent_power_w = in.number("noise_equivalent_power_w", kPower_w, s.noise_equivalent_power_w);
  if (in.has("temperatures_k")) {
    query.temperatures_k.clear();
    in.at("temperatures_k").elements(1, 16, [&](const JsonReader& t) {
      query.temperatures_k.push_back(t.number(kBlackbody_k));
    });
  }
  return query;
}

OrderedJson instrument_json(const MertisQuery& query) {
  const engine::Spectrometer& s = query.spectrometer;
  OrderedJson efficiency = OrderedJson::array();
  for (const engine::EfficiencyPoint& p : s.efficiency) efficiency.push_back({p.wavelength_um, p.efficiency});
  return {{"first_um", s.first_um},
          {"last_um", s.last_um},
          {"channels", s.channels},
          {"pixel_pitch_um", s.pixel_pitch_um},
          {"f_number", s.f_number},
          {"efficiency", efficiency},
          {"noise_equivalent_power_w", s.noise_equivalent_power_w},
          {"temperatures_k", query.temperatures_k}};
}

constexpr const char* kAssumptions[] = {
    "SENSOR++ prints 80 channels from 7 to 14 um and equations (3), (9) and (12); it doesn't print what follows",
    "channels of equal width",
    "f/2 and pixels of 35 um (Hiesinger, Helbert et al. 2010)",
    "efficiency of optics and grating 0.3 at all wavelengths",
    "noise-equivalent power 1 pW per channel, after averaging over frames",
    "blackbodies of 350 and 500 K",
};

}  // namespace

MertisQuery read_mertis(const Json& body) {
  Findings findings;
  MertisQuery query = read_members(JsonReader(body, findings));
  findings.throw_if_any();
  return query;
}

OrderedJson mertis_json(const MertisQuery& query, const StopToken& stop) {
  OrderedJson spectra = OrderedJson::array();
  for (const double kelvin : query.temperatures_k) {
    stop.check();
    OrderedJson channels = OrderedJson::array();
    for (const SpectrometerChannel& c : engine::look_at_blackbody(query.spectrometer, kelvin))
      channels.push_back({{"center_um", c.center_um},
                          {"width_um", c.width_um},
                          {"radiance_w_m2_sr_um", c.radiance_w_m2_sr_um},
                          {"flux_w", c.flux_w},
                          {"noise_equivalent_power_w", query.spectrometer.noise_equivalent_power_w},
                          {"signal_to_noise", c.signal_to_noise},
                          {"width_error", c.width_error}});
    spectra.push_back({{"temperature_k", kelvin}, {"channels", channels}});
  }
  return {{"instrument", instrument_json(query)}, {"assumptions_of_the_defaults", kAssumptions}, {"spectra", spectra}};
}

std::string mertis_csv(const MertisQuery& query) {
  std::string csv = "# SENSOR++ equations (3), (9), (12)\n";
  for (const char* assumption : kAssumptions) csv += fmt::format("# defaults: {}\n", assumption);
  csv +=
      "temperature_k,channel,center_um,width_um,efficiency,radiance_w_m2_sr_um,flux_w,noise_equivalent_power_w,"
      "signal_to_noise,width_error\n";
  for (const double kelvin : query.temperatures_k) {
    int channel = 0;
    for (const SpectrometerChannel& c : engine::look_at_blackbody(query.spectrometer, kelvin))
      csv += fmt::format("{:g},{},{:.9g},{:.9g},{:.6g},{:.9g},{:.9g},{:g},{:.9g},{:.3e}\n", kelvin, ++channel,
                         c.center_um, c.width_um, c.efficiency, c.radiance_w_m2_sr_um, c.flux_w,
                         query.spectrometer.noise_equivalent_power_w, c.signal_to_noise, c.width_error);
  }
  return csv;
}

}  // namespace selenograph::api
