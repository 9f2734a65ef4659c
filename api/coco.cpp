#include "api/coco.h"

#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>
#include <vector>

#include "api/detail_json.h"
#include "api/features_json.h"
#include "api/metadata.h"

namespace selenograph::api {
namespace {

// In COCO's coordinates.
struct Corner {
  double x, y;
};
using Polygon = std::vector<Corner>;

// What of a polygon is where `inside` isn't negative (Sutherland & Hodgman 1974).
Polygon clipped(const Polygon& polygon, const std::function<double(const Corner&)>& inside) {
  Polygon out;
  for (std::size_t i = 0; i < polygon.size(); ++i) {
    const Corner &a = polygon[i], &b = polygon[(i + 1) % polygon.size()];
    const double of_a = inside(a), of_b = inside(b);
    if (of_a >= 0) out.push_back(a);
    if ((of_a >= 0) == (of_b >= 0)) continue;
    const double t = of_a / (of_a - of_b);
    out.push_back({std::lerp(a.x, b.x, t), std::lerp(a.y, b.y, t)});
  }
  return out;
}

double thousandths(double x) { return std::round(x * 1000) / 1000; }

Polygon in_image(const std::vector<engine::RimPoint>& outline, double width, double height) {
  Polygon polygon;
  for (const engine::RimPoint& p : outline) polygon.push_back({p.x_px + 0.5, p.y_px + 0.5});
  polygon = clipped(polygon, [](const Corner& c) { return c.x; });
  polygon = clipped(polygon, [](const Corner& c) { return c.y; });
  polygon = clipped(polygon, [&](const Corner& c) { return width - c.x; });
  polygon = clipped(polygon, [&](const Corner& c) { return height - c.y; });
  for (Corner& c : polygon) c = {std::clamp(thousandths(c.x), 0.0, width), std::clamp(thousandths(c.y), 0.0, height)};
  return polygon;
}

double area_of(const Polygon& polygon) {
  double twice = 0;
  for (std::size_t i = 0; i < polygon.size(); ++i) {
    const Corner &a = polygon[i], &b = polygon[(i + 1) % polygon.size()];
    twice += a.x * b.y - b.x * a.y;
  }
  return std::abs(twice) / 2;
}

OrderedJson box_of(const Polygon& polygon) {
  Corner least = polygon[0], most = polygon[0];
  for (const Corner& c : polygon) {
    least = {std::min(least.x, c.x), std::min(least.y, c.y)};
    most = {std::max(most.x, c.x), std::max(most.y, c.y)};
  }
  return {least.x, least.y, thousandths(most.x - least.x), thousandths(most.y - least.y)};
}

OrderedJson annotation(const engine::CraterRim& rim, const Polygon& polygon, double area, std::size_t id) {
  OrderedJson flat = OrderedJson::array();
  for (const Corner& c : polygon) flat.push_back(c.x), flat.push_back(c.y);
  OrderedJson json{{"id", id},
                   {"image_id", 1},
                   {"category_id", 1},
                   {"bbox", box_of(polygon)},
                   {"segmentation", OrderedJson::array({std::move(flat)})},
                   {"area", thousandths(area)},
                   {"iscrowd", 0},
                   {"crater_id", id_text(rim.feature.crater.id)}};
  for (const auto& column : crater_columns()) json[std::string(column.name)] = column.value(rim.feature);
  json["rim_visible"] = rim.rim_visible;
  json["center"] = nullptr;
  if (!std::isnan(rim.centre.x_px))
    json["center"] = {thousandths(rim.centre.x_px + 0.5), thousandths(rim.centre.y_px + 0.5)};
  json["center_visible"] = rim.centre_visible;
  return json;
}

}  // namespace

OrderedJson coco_json(const FrameQuery& query, const engine::CraterRims& rims, const std::string& image) {
  const engine::Camera& camera = query.request.camera;
  OrderedJson annotations = OrderedJson::array();
  for (const engine::CraterRim& rim : rims.rims) {
    const Polygon polygon = in_image(rim.outline, camera.width, camera.height);
    constexpr double kLeastArea_px = 1e-3;
    if (const double area = area_of(polygon); polygon.size() >= 3 && area > kLeastArea_px)
      annotations.push_back(annotation(rim, polygon, area, annotations.size() + 1));
  }
  return {{"info",
           {{"description", "Craters of a selenograph frame"},
            {"version", software_version()},
            {"detail", detail_metadata(query.detail, *query.request.detail)},
            {"request", resolved_json(query)}}},
          {"licenses", OrderedJson::array()},
          {"images", {{{"id", 1}, {"width", camera.width}, {"height", camera.height}, {"file_name", image}}}},
          {"categories", {{{"id", 1}, {"name", "crater"}, {"supercategory", "landform"}}}},
          {"annotations", std::move(annotations)}};
}

}  // namespace selenograph::api
