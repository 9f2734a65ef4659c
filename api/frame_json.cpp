#include "api/frame_json.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "api/arrays.h"
#include "api/ranges.h"
#include "api/sensor_json.h"
#include "api/surface_json.h"
#include "dem/error.h"

namespace selenograph::api {
namespace {

using OrderedJson = nlohmann::ordered_json;

std::vector<std::pair<std::string_view, engine::Product>> product_words() {
  std::vector<std::pair<std::string_view, engine::Product>> words;
  for (const ProductRow& row : products()) words.emplace_back(row.name, row.product);
  return words;
}

engine::ProductSet read_products(const JsonReader& in) {
  static const auto words = product_words();
  engine::ProductSet products = 0;
  in.elements(1, words.size(), [&](const JsonReader& element) {
    const auto product = element.word(Words<engine::Product>(words));
    if (!product) return;
    if (products & *product) element.fail("is listed twice");
    products |= *product;
  });
  return products;
}

// A budget chooses what it would exclude otherwise.
std::optional<double> read_budget(const JsonReader& in) {
  if (!in.has("budget_ms")) return std::nullopt;
  for (const std::string_view name : {"max_error_px", "samples_per_pixel", "max_shadow_error_px"})
    if (in.has(name)) in.fail("budget_ms", "chooses the accuracy: not together with \"" + std::string(name) + "\"");
  return in.number("budget_ms", kBudget_ms, 0);
}

engine::Accuracy read_accuracy(const JsonReader& in, const Limits& limits) {
  engine::Accuracy accuracy;
  if (!in.object({"max_error_px", "samples_per_pixel", "max_shadow_error_px", "budget_ms"})) return accuracy;
  accuracy.max_error_px = in.number("max_error_px", kMaxError_px, accuracy.max_error_px);
  accuracy.samples_per_pixel =
      static_cast<int>(in.integer("samples_per_pixel", 1, limits.max_samples_per_pixel, accuracy.samples_per_pixel));
  accuracy.max_shadow_error_px = in.number("max_shadow_error_px", kMaxShadowError_px, accuracy.max_shadow_error_px);
  const int side = static_cast<int>(std::lround(std::sqrt(accuracy.samples_per_pixel)));
  if (side * side != accuracy.samples_per_pixel)
    in.fail("samples_per_pixel", "must be a square number: 1, 4, 9, 16, ...");
  return accuracy;
}

engine::ImageSettings read_image(const JsonReader& in) {
  engine::ImageSettings image;
  if (!in.object({"bit_depth", "full_scale_radiance"})) return image;
  image.bit_depth = static_cast<int>(in.integer("bit_depth", 8, 16, image.bit_depth));
  if (image.bit_depth != 8 && image.bit_depth != 16) in.fail("bit_depth", "must be 8 or 16");
  if (in.has("full_scale_radiance")) {
    const JsonReader scale = in.at("full_scale_radiance");
    if (scale.value().is_number()) {
      image.full_scale_radiance_w_m2_sr = scale.number(kFullScaleRadiance);
    } else if (scale.value() != "auto") {
      scale.fail("must be a number (W m-2 sr-1) or \"auto\"");
    }
  }
  return image;
}

// Either a rectangle or a curve.
std::optional<engine::Band> read_band(const JsonReader& in) {
  if (!in.object({"center_um", "width_um", "response"})) return std::nullopt;
  const std::string_view form = in.alternative({"center_um", "response"}, true);
  if (form.empty()) return std::nullopt;
  if (form == "response" && in.has("width_um")) in.fail("width_um", "belongs to \"center_um\", not to \"response\"");
  std::vector<engine::ResponsePoint> curve;
  if (form == "response")
    in.at("response").elements(2, kMaxResponsePoints, [&](const JsonReader& point) {
      if (const auto p = point.pair(kWavelength_um, kUnitInterval)) curve.push_back({p->first, p->second});
    });
  const double center_um = form == "response" ? 1 : in.number("center_um", kWavelength_um),
               width_um = form == "response" ? 1 : in.number("width_um", kWavelength_um);
  if (!in.good()) return std::nullopt;
  if (form != "response" && !kWavelength_um.contains(center_um + width_um / 2))
    in.fail("width_um", fmt::format("the band must end at {} um or before", kWavelength_um.max));
  try {
    return form == "response" ? engine::Band(std::move(curve)) : engine::Band(center_um, width_um);
  } catch (const ImpossibleRequest& e) {
    in.fail(form == "response" ? form : "width_um", e.what());
    return std::nullopt;
  }
}

void read_atmosphere(const JsonReader& in, const Assets& assets, FrameQuery& query) {
  if (!in.object({"name"})) return;
  if (!in.has("name")) return in.fail("name", "is required");
  const JsonReader named = in.at("name");
  const std::optional<std::string> name = named.text();
  if (!name) return;
  query.request.atmosphere = assets.atmosphere(*name);
  if (query.request.atmosphere) {
    query.atmosphere_name = *name;
    try {
      if (query.request.band) query.request.atmosphere->over(*query.request.band, 0);
    } catch (const ImpossibleRequest& e) {
      in.fail(e.what());
    }
    return;
  }
  named.fail("no such atmosphere; the service has " + listed(assets.names("atmospheres")));
}

void require_sun(const JsonReader& in, engine::ProductSet wanted) {
  for (const ProductRow& row : products()) {
    if (!row.needs_sun || !(wanted & row.product)) continue;
    in.fail("sun", "is required for the product \"" + std::string(row.name) + "\"");
    return;
  }
}

FrameQuery read_members(const JsonReader& in, const Limits& limits, const Assets& assets) {
  FrameQuery query;
  engine::FrameRequest& request = query.request;
  if (!in.object({"camera", "pose", "sun", "surface", "band", "atmosphere", "objects", "terrain", "accuracy", "image",
                  "sensor", "camera_preset", "visibility", "products"}))
    return query;
  if (in.has("camera_preset")) in.fail("camera_preset", "must be a string");  // else it is resolved by now
  for (const std::string_view name : {"camera", "pose"}) {
    if (!in.has(name)) in.fail(name, "is required");
  }
  if (in.has("camera")) request.camera = read_camera(in.at("camera"), limits);
  if (in.has("pose")) request.pose = read_pose(in.at("pose"));
  if (in.has("surface")) read_surface(in.at("surface"), assets, request, query.surface);
  if (in.has("band")) request.band = read_band(in.at("band"));
  if (in.has("atmosphere")) {
    if (!in.has("band")) in.fail("atmosphere", "needs a \"band\"");
    read_atmosphere(in.at("atmosphere"), assets, query);
  }
  if (in.has("objects")) read_objects(in.at("objects"), assets, request, query.objects);
  request.terrain = in.flag("terrain", true);
  if (!request.terrain && !in.has("objects")) in.fail("terrain", "without terrain and \"objects\" there is nothing");
  if (in.has("accuracy")) {
    request.accuracy = read_accuracy(in.at("accuracy"), limits);
    if (in.at("accuracy").value().is_object()) query.budget_ms = read_budget(in.at("accuracy"));
  }
  if (in.has("image")) request.image = read_image(in.at("image"));
  if (in.has("sensor")) {
    if (in.has("image")) in.fail("image", "is exposure without a sensor: not together with \"sensor\"");
    if (!in.has("band")) in.fail("sensor", "needs a \"band\": which photons it counts");
    request.sensor = read_sensor(in.at("sensor"), assets);
  }
  request.visibility = in.word("visibility", Words<engine::Visibility>(kVisibilities), request.visibility);
  if (!request.terrain && request.visibility == engine::Visibility::zbuffer)
    in.fail("visibility", "\"zbuffer\" draws terrain, and there is none");
  if (in.has("products")) request.products = read_products(in.at("products"));
  query.sun_given = in.has("sun");
  if (query.sun_given) {
    request.sun = read_sun(in.at("sun"));
  } else {
    require_sun(in, request.products);
  }
  return query;
}

// A preset's faults are the operator's: they are told with the file's name.
void check_preset(const Json& preset, const std::string& name, const Limits& limits, const Assets& assets) {
  Findings findings;
  const JsonReader in(preset, findings);
  if (in.object({"description", "camera", "band", "sensor"})) {
    if (in.has("description")) in.at("description").text();
    if (in.has("camera")) read_camera(in.at("camera"), limits);
    if (in.has("band")) read_band(in.at("band"));
    if (in.has("sensor")) read_sensor(in.at("sensor"), assets);
  }
  try {
    findings.throw_if_any();
  } catch (const RequestError& e) {
    throw RequestError("asset_error",
                       fmt::format("cameras/{}.json: {}: {}", name, e.findings()[0].pointer, e.findings()[0].detail));
  }
}

// The request with the preset's members where it has none of its own; of the sensor, member by member.
Json with_preset(const Json& body, const Limits& limits, const Assets& assets) {
  Findings findings;
  const JsonReader in(body, findings);
  const JsonReader named = in.at("camera_preset");
  const std::string name = named.text().value_or("");
  const std::shared_ptr<const Json> preset = assets.camera(name);
  if (!preset && findings.empty()) named.fail("no such preset; the service has " + listed(assets.names("cameras")));
  findings.throw_if_any();
  check_preset(*preset, name, limits, assets);
  Json merged = body;
  merged.erase("camera_preset");
  for (const char* member : {"camera", "band"})
    if (preset->contains(member) && !merged.contains(member)) merged[member] = preset->at(member);
  if (preset->contains("sensor")) {
    Json sensor = preset->at("sensor");
    if (merged.contains("sensor")) sensor.merge_patch(merged["sensor"]);
    merged["sensor"] = sensor;
  }
  return merged;
}

OrderedJson camera_json(const engine::Camera& camera) {
  const engine::Distortion& d = camera.distortion;
  return {{"model", "pinhole"},
          {"width", camera.width},
          {"height", camera.height},
          {"fx", camera.fx},
          {"fy", camera.fy},
          {"cx", camera.cx},
          {"cy", camera.cy},
          {"distortion",
           {{"model", "brown_conrady"}, {"k1", d.k1}, {"k2", d.k2}, {"k3", d.k3}, {"p1", d.p1}, {"p2", d.p2}}}};
}

OrderedJson vector_json(const Vec3& v) { return OrderedJson::array({v.x(), v.y(), v.z()}); }

OrderedJson quaternion_json(const Eigen::Quaterniond& q) {
  return {{"w", q.w()}, {"x", q.x()}, {"y", q.y()}, {"z", q.z()}};
}

OrderedJson pose_json(const engine::Pose& pose) {
  return {{"frame", "MOON_ME"},
          {"position_m", vector_json(pose.position_m)},
          {"camera_from_moon", quaternion_json(pose.camera_from_moon)},
          {"axes", "opencv"}};
}

OrderedJson band_json(const engine::Band& band) {
  OrderedJson curve = OrderedJson::array();
  for (const engine::ResponsePoint& p : band.response()) curve.push_back({p.wavelength_um, p.response});
  return {{"response", curve}};
}

OrderedJson image_json(const engine::ImageSettings& image) {
  const auto& scale = image.full_scale_radiance_w_m2_sr;
  return {{"bit_depth", image.bit_depth}, {"full_scale_radiance", scale ? OrderedJson(*scale) : OrderedJson("auto")}};
}

}  // namespace

std::string_view visibility_name(engine::Visibility visibility) { return word_of(kVisibilities, visibility); }

OrderedJson object_pose_json(const engine::SceneObject& object) {
  return {{"frame", "MOON_ME"},
          {"position_m", vector_json(object.position_m)},
          {"moon_from_object", quaternion_json(object.moon_from_object)}};
}

FrameQuery read_frame(const Json& body, const Limits& limits, const Assets& assets) {
  if (body.is_object() && body.contains("camera_preset") && body.at("camera_preset").is_string())
    return read_frame(with_preset(body, limits, assets), limits, assets);
  Findings findings;
  const FrameQuery query = read_members(JsonReader(body, findings), limits, assets);
  findings.throw_if_any();
  return query;
}

OrderedJson resolved_json(const FrameQuery& query) {
  const engine::FrameRequest& request = query.request;
  OrderedJson json{{"camera", camera_json(request.camera)}, {"pose", pose_json(request.pose)}};
  if (query.sun_given) {
    json["sun"] = {{"direction", vector_json(request.sun.direction)},
                   {"distance_au", request.sun.distance_au},
                   {"angular_radius_deg", request.sun.angular_radius_deg}};
    if (request.sun.limb_darkening > 0) json["sun"]["limb_darkening"] = request.sun.limb_darkening;
  }
  json["surface"] = surface_json(request, query.surface);
  if (request.band) json["band"] = band_json(*request.band);
  if (request.atmosphere) json["atmosphere"] = {{"name", query.atmosphere_name}};
  if (!query.objects.empty()) json["objects"] = objects_json(request, query.objects);
  if (!request.terrain) json["terrain"] = false;
  json["visibility"] = visibility_name(request.visibility);
  json["accuracy"] = {{"max_error_px", request.accuracy.max_error_px},
                      {"samples_per_pixel", request.accuracy.samples_per_pixel},
                      {"max_shadow_error_px", request.accuracy.max_shadow_error_px}};
  if (request.products & engine::kImage) {
    if (request.sensor)
      json["sensor"] = sensor_json(*request.sensor);
    else
      json["image"] = image_json(request.image);
  }
  json["products"] = OrderedJson::array();
  for (const ProductRow& row : products()) {
    if (request.products & row.product) json["products"].push_back(row.name);
  }
  return json;
}

}  // namespace selenograph::api
