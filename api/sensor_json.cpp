#include "api/sensor_json.h"

#include <fmt/format.h>

#include <array>

#include "api/ranges.h"

namespace selenograph::api {
namespace {

using engine::Detector;
using engine::PointSpread;
using engine::Vignetting;
using OrderedJson = nlohmann::ordered_json;

constexpr Range kAboveZero{0, 1e9, true, false};
constexpr Range kNotNegative{0, 1e9};

constexpr std::array<DetectorMember, 15> kMembers{{
    {"pixel_pitch_um", {0, 1e4, true, false}, true, "p of SENSOR++ eq. (8)", &Detector::pixel_pitch_um},
    {"quantum_efficiency",
     {0, 1, true, false},
     true,
     "eta of eq. (8): of optics and detector",
     &Detector::quantum_efficiency},
    {"integration_time_s", {0, 1e5, true, false}, true, "t of eq. (8)", &Detector::integration_time_s},
    {"full_well_e", kNotNegative, false, "electrons that a pixel holds; 0: any number", &Detector::full_well_e},
    {"dark_current_e_s", kNotNegative, false, "electrons per second and pixel", &Detector::dark_current_e_s},
    {"smear_time_s", kNotNegative, false,
     "electronic smear of frame transfer without a shutter: how long a row passes each row of the image",
     &Detector::smear_time_s},
    {"read_noise_e", kNotNegative, false, "standard deviation", &Detector::read_noise_e},
    {"prnu", kUnitInterval, false,
     "photo response non-uniformity: relative standard deviation of the pixels' responses", &Detector::prnu},
    {"dsnu_e", kNotNegative, false, "dark signal non-uniformity: standard deviation of the pixels' offsets",
     &Detector::dsnu_e},
    {"dead_fraction", kUnitInterval, false, "share of the pixels that see nothing", &Detector::dead_fraction},
    {"hot_fraction", kUnitInterval, false, "share of the pixels whose dark current is higher", &Detector::hot_fraction},
    {"hot_current_e_s", kNotNegative, false, "by this much", &Detector::hot_current_e_s},
    {"gain_e_dn", kAboveZero, true, "electrons per digital number", &Detector::gain_e_dn},
    {"offset_dn", {0, 65535}, false, "digital number of no electrons", &Detector::offset_dn},
    {"bit_depth",
     {1, 16},
     false,
     "digital numbers from 0 to 2^bit_depth - 1; the image is uint8 up to 8, else uint16",
     nullptr},
}};

void refuse_unless(const JsonReader& in, bool belongs, std::string_view member, std::string_view model) {
  if (!belongs && in.has(member)) in.fail(member, "belongs to the model \"" + std::string(model) + "\"");
  if (belongs && !in.has(member)) in.fail(member, "is required for the model \"" + std::string(model) + "\"");
}

using Rows = std::vector<std::vector<double>>;

Rows read_rows(const JsonReader& in) {
  Rows rows;
  in.elements(1, kMaxKernelSide, [&](const JsonReader& row) {
    rows.emplace_back();
    row.elements(1, kMaxKernelSide,
                 [&](const JsonReader& weight) { rows.back().push_back(weight.number(kNotNegative)); });
  });
  return rows;
}

// In the request, or a file of the assets folder by name.
void read_kernel(const JsonReader& in, const Assets& assets, PointSpread& spread) {
  std::shared_ptr<const Rows> rows;
  if (in.value().is_string()) {
    rows = assets.kernel(*in.text());
    if (!rows) return in.fail("no such kernel; the service has " + listed(assets.names("kernels")));
  } else {
    rows = std::make_shared<const Rows>(read_rows(in));
  }
  if (!in.good()) return;
  double sum = 0;
  bool fits = rows->size() % 2 == 1 && rows->size() <= kMaxKernelSide;
  for (const std::vector<double>& row : *rows) {
    fits &= row.size() == rows->size();
    for (const double weight : row) fits &= kNotNegative.contains(weight), sum += weight;
    spread.kernel.insert(spread.kernel.end(), row.begin(), row.end());
  }
  spread.side = static_cast<int>(rows->size());
  if (!fits)
    in.fail(fmt::format("must have as many columns as rows, an odd number up to {}, and no negative weight",
                        kMaxKernelSide));
  if (!(sum > 0)) in.fail("must not be 0 everywhere");
}

PointSpread read_point_spread(const JsonReader& in, const Assets& assets) {
  PointSpread spread;
  if (!in.object({"model", "sigma_px", "kernel"})) return spread;
  if (!in.has("model")) in.fail("model", "is required");
  spread.model = in.word("model", Words<PointSpread::Model>(kPointSpreads), spread.model);
  const bool gaussian = spread.model == PointSpread::Model::gaussian,
             kernel = spread.model == PointSpread::Model::kernel;
  refuse_unless(in, gaussian, "sigma_px", "gaussian");
  refuse_unless(in, kernel, "kernel", "kernel");
  if (gaussian && in.has("sigma_px")) spread.sigma_px = in.number("sigma_px", kSigma_px);
  if (kernel && in.has("kernel")) read_kernel(in.at("kernel"), assets, spread);
  return spread;
}

Vignetting read_vignetting(const JsonReader& in) {
  Vignetting vignetting;
  if (!in.object({"model", "table"})) return vignetting;
  if (!in.has("model")) in.fail("model", "is required");
  vignetting.model = in.word("model", Words<Vignetting::Model>(kVignettings), vignetting.model);
  const bool table = vignetting.model == Vignetting::Model::table;
  refuse_unless(in, table, "table", "table");
  if (!table || !in.has("table")) return vignetting;
  const JsonReader points = in.at("table");
  points.elements(1, kMaxVignettingPoints, [&](const JsonReader& point) {
    const auto p = point.pair(kOffBoresight_deg, kUnitInterval);
    if (!p) return;
    if (!vignetting.table.empty() && !(p->first > vignetting.table.back().angle_deg))
      in.fail("table", "its angles must rise");
    vignetting.table.push_back({p->first, p->second});
  });
  return vignetting;
}

engine::Motion read_motion(const JsonReader& in) {
  engine::Motion motion;
  if (!in.object({"angular_rate_deg_s", "velocity_m_s", "samples"})) return motion;
  if (in.has("angular_rate_deg_s")) motion.angular_rate_deg_s = in.at("angular_rate_deg_s").vector(kAngularRate_deg_s);
  if (in.has("velocity_m_s")) motion.velocity_m_s = in.at("velocity_m_s").vector(kVelocity_m_s);
  motion.samples = static_cast<int>(in.integer("samples", 1, kMaxMotionSamples, motion.samples));
  return motion;
}

engine::Optics read_optics(const JsonReader& in, const Assets& assets) {
  engine::Optics optics;
  if (!in.object({"f_number", "point_spread", "vignetting"})) return optics;
  optics.f_number = in.number("f_number", kFNumber);
  if (in.has("point_spread")) optics.point_spread = read_point_spread(in.at("point_spread"), assets);
  if (in.has("vignetting")) optics.vignetting = read_vignetting(in.at("vignetting"));
  return optics;
}

Detector read_detector(const JsonReader& in) {
  Detector detector;
  if (!in.object({"pixel_pitch_um", "quantum_efficiency", "integration_time_s", "full_well_e", "dark_current_e_s",
                  "smear_time_s", "photon_noise", "read_noise_e", "prnu", "dsnu_e", "dead_fraction", "hot_fraction",
                  "hot_current_e_s", "gain_e_dn", "offset_dn", "bit_depth"}))
    return detector;
  for (const DetectorMember& member : kMembers) {
    if (!member.of) continue;
    double& value = detector.*member.of;
    value = member.required ? in.number(member.name, member.range) : in.number(member.name, member.range, value);
  }
  detector.bit_depth = static_cast<int>(in.integer("bit_depth", 1, 16, detector.bit_depth));
  detector.photon_noise = in.flag("photon_noise", detector.photon_noise);
  if (detector.dead_fraction + detector.hot_fraction > 1) in.fail("hot_fraction", "is more than what isn't dead");
  return detector;
}

OrderedJson point_spread_json(const PointSpread& spread) {
  OrderedJson json{{"model", word_of(kPointSpreads, spread.model)}};
  if (spread.model == PointSpread::Model::gaussian) json["sigma_px"] = spread.sigma_px;
  if (spread.model == PointSpread::Model::kernel) {
    json["kernel"] = OrderedJson::array();
    for (auto row = spread.kernel.begin(); row != spread.kernel.end(); row += spread.side)
      json["kernel"].push_back(std::vector<double>(row, row + spread.side));
  }
  return json;
}

OrderedJson vignetting_json(const Vignetting& vignetting) {
  OrderedJson json{{"model", word_of(kVignettings, vignetting.model)}};
  if (vignetting.model == Vignetting::Model::table)
    for (const auto& p : vignetting.table) json["table"].push_back({p.angle_deg, p.transmission});
  return json;
}

}  // namespace

std::span<const DetectorMember> detector_members() { return kMembers; }

engine::SensorModel read_sensor(const JsonReader& in, const Assets& assets) {
  engine::SensorModel sensor;
  if (!in.object({"optics", "detector", "motion", "seed", "frame"})) return sensor;
  for (const std::string_view name : {"optics", "detector"})
    if (!in.has(name)) in.fail(name, "is required");
  if (in.has("optics")) sensor.optics = read_optics(in.at("optics"), assets);
  if (in.has("detector")) sensor.detector = read_detector(in.at("detector"));
  if (in.has("motion")) sensor.motion = read_motion(in.at("motion"));
  sensor.seed = static_cast<std::uint64_t>(in.integer("seed", 0, kMaxSeed, 0));
  sensor.frame = static_cast<std::uint64_t>(in.integer("frame", 0, kMaxSeed, 0));
  return sensor;
}

OrderedJson sensor_json(const engine::SensorModel& sensor) {
  OrderedJson detector;
  for (const DetectorMember& member : kMembers)
    if (member.of) detector[std::string(member.name)] = sensor.detector.*member.of;
  detector["bit_depth"] = sensor.detector.bit_depth;
  detector["photon_noise"] = sensor.detector.photon_noise;
  OrderedJson json{{"optics",
                    {{"f_number", sensor.optics.f_number},
                     {"point_spread", point_spread_json(sensor.optics.point_spread)},
                     {"vignetting", vignetting_json(sensor.optics.vignetting)}}},
                   {"detector", detector}};
  if (const engine::Motion& m = sensor.motion; !m.none())
    json["motion"] = {
        {"angular_rate_deg_s", {m.angular_rate_deg_s.x(), m.angular_rate_deg_s.y(), m.angular_rate_deg_s.z()}},
        {"velocity_m_s", {m.velocity_m_s.x(), m.velocity_m_s.y(), m.velocity_m_s.z()}},
        {"samples", m.samples}};
  json["seed"] = sensor.seed, json["frame"] = sensor.frame;
  return json;
}

}  // namespace selenograph::api
