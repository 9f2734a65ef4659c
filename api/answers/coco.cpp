#include "api/answers/coco.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <functional>
#include <limits>
#include <utility>
#include <vector>

#include "api/answers/crater_answer.h"
#include "api/answers/metadata.h"
#include "api/requests/features_json.h"
#include "api/requests/parts/detail_json.h"

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

// The pixels that see a rock, down one column of the image after the other: COCO's order.
struct Mask {
  std::vector<std::size_t> runs;  // of other pixels and its own, in turn
  std::size_t past_last = 0, area = 0;
  int left = std::numeric_limits<int>::max(), right = -1, top = std::numeric_limits<int>::max(), bottom = -1;

  void add(int x, int y, std::size_t at) {
    if (area > 0 && at == past_last)
      ++runs.back();
    else
      runs.push_back(at - past_last), runs.push_back(1);
    past_last = at + 1, ++area;
    left = std::min(left, x), right = std::max(right, x), top = std::min(top, y), bottom = std::max(bottom, y);
  }
};

std::vector<Mask> masks_of(const engine::Frame& frame, const engine::Camera& camera) {
  std::vector<Mask> masks(frame.rocks.size());
  if (masks.empty()) return masks;
  std::size_t at = 0;
  for (int x = 0; x < camera.width; ++x)
    for (int y = 0; y < camera.height; ++y, ++at) {
      const std::uint16_t rock = frame.products.rock[static_cast<std::size_t>(y) * camera.width + x];
      if (rock < masks.size()) masks[rock].add(x, y, at);
    }
  return masks;
}

OrderedJson annotation(const dem::RockFeature& rock, Mask mask, const engine::Camera& camera, std::size_t id) {
  const std::size_t pixels = static_cast<std::size_t>(camera.width) * static_cast<std::size_t>(camera.height);
  if (mask.past_last < pixels) mask.runs.push_back(pixels - mask.past_last);
  OrderedJson json{{"id", id},
                   {"image_id", 1},
                   {"category_id", 2},
                   {"bbox", {mask.left, mask.top, mask.right - mask.left + 1, mask.bottom - mask.top + 1}},
                   {"segmentation", {{"size", {camera.height, camera.width}}, {"counts", mask.runs}}},
                   {"area", mask.area},
                   {"iscrowd", 0},
                   {"rock_id", id_text(rock.rock.id)}};
  for (const auto& column : rock_columns()) json[std::string(column.name)] = column.value(rock);
  return json;
}

}  // namespace

OrderedJson coco_json(const FrameQuery& query, const engine::Frame& frame, double least_px, const std::string& image) {
  const engine::Camera& camera = query.request.camera;
  OrderedJson annotations = OrderedJson::array();
  for (const engine::CraterRim& rim : frame.report.craters.rims) {
    const Polygon polygon = in_image(rim.outline, camera.width, camera.height);
    constexpr double kLeastArea_px = 1e-3;
    if (const double area = area_of(polygon); polygon.size() >= 3 && area > kLeastArea_px)
      annotations.push_back(annotation(rim, polygon, area, annotations.size() + 1));
  }
  std::vector<Mask> masks = masks_of(frame, camera);
  for (std::size_t i = 0; i < masks.size(); ++i)
    if (masks[i].area > 0 && 4 * static_cast<double>(masks[i].area) >= M_PI * least_px * least_px)
      annotations.push_back(annotation(frame.rocks[i], std::move(masks[i]), camera, annotations.size() + 1));
  return {{"info",
           {{"description", "Craters and rocks of a selenograph frame"},
            {"version", software_version()},
            {"detail", detail_metadata(query.detail, *query.request.detail)},
            {"request", resolved_json(query)}}},
          {"licenses", OrderedJson::array()},
          {"images", {{{"id", 1}, {"width", camera.width}, {"height", camera.height}, {"file_name", image}}}},
          {"categories",
           {{{"id", 1}, {"name", "crater"}, {"supercategory", "landform"}},
            {{"id", 2}, {"name", "rock"}, {"supercategory", "landform"}}}},
          {"annotations", std::move(annotations)}};
}

}  // namespace selenograph::api
