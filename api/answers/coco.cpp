#include "api/answers/coco.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <utility>

#include "api/answers/crater_answer.h"
#include "api/answers/metadata.h"
#include "api/message/problem.h"
#include "api/requests/features_json.h"
#include "api/requests/parts/detail_json.h"

namespace selenograph::api {
namespace {

constexpr int kCraterCategory = 1, kRockCategory = 2;

// What of a polygon is where `inside` isn't negative (Sutherland & Hodgman 1974).
template <typename Inside>
ImagePolygon clipped(const ImagePolygon& polygon, const Inside& inside) {
  ImagePolygon out;
  for (std::size_t i = 0; i < polygon.size(); ++i) {
    const ImageCorner &a = polygon[i], &b = polygon[(i + 1) % polygon.size()];
    const double of_a = inside(a), of_b = inside(b);
    if (of_a >= 0) out.push_back(a);
    if ((of_a >= 0) == (of_b >= 0)) continue;
    const double t = of_a / (of_a - of_b);
    out.push_back({std::lerp(a.x, b.x, t), std::lerp(a.y, b.y, t)});
  }
  return out;
}

ImagePolygon in_image(const std::vector<engine::RimPoint>& outline, double width, double height) {
  ImagePolygon polygon;
  for (const engine::RimPoint& p : outline) polygon.push_back({p.x_px + 0.5, p.y_px + 0.5});
  polygon = clipped(polygon, [](const ImageCorner& c) { return c.x; });
  polygon = clipped(polygon, [](const ImageCorner& c) { return c.y; });
  polygon = clipped(polygon, [&](const ImageCorner& c) { return width - c.x; });
  polygon = clipped(polygon, [&](const ImageCorner& c) { return height - c.y; });
  for (ImageCorner& c : polygon)
    c = {std::clamp(thousandths(c.x), 0.0, width), std::clamp(thousandths(c.y), 0.0, height)};
  return polygon;
}

double area_of(const ImagePolygon& polygon) {
  double twice = 0;
  for (std::size_t i = 0; i < polygon.size(); ++i) {
    const ImageCorner &a = polygon[i], &b = polygon[(i + 1) % polygon.size()];
    twice += a.x * b.y - b.x * a.y;
  }
  return std::abs(twice) / 2;
}

OrderedJson box_of(const ImagePolygon& polygon) {
  ImageCorner least = polygon[0], most = polygon[0];
  for (const ImageCorner& c : polygon) {
    least = {std::min(least.x, c.x), std::min(least.y, c.y)};
    most = {std::max(most.x, c.x), std::max(most.y, c.y)};
  }
  return {least.x, least.y, thousandths(most.x - least.x), thousandths(most.y - least.y)};
}

// Where a polygon's border crosses the row's line of pixel centres, from the left; reused from row to row.
void crossings(const ImagePolygon& polygon, double y, std::vector<double>& at) {
  at.clear();
  for (std::size_t i = 0; i < polygon.size(); ++i) {
    const ImageCorner &a = polygon[i], &b = polygon[(i + 1) % polygon.size()];
    if ((a.y > y) != (b.y > y)) at.push_back(a.x + (y - a.y) / (b.y - a.y) * (b.x - a.x));
  }
  std::sort(at.begin(), at.end());
}

// Gives the pixels whose centres are in a polygon a value.
void fill(const ImagePolygon& polygon, const engine::Camera& camera, std::uint16_t value,
          std::vector<std::uint16_t>& mask) {
  const auto [top, bottom] =
      std::minmax_element(polygon.begin(), polygon.end(), [](const auto& a, const auto& b) { return a.y < b.y; });
  // The first pixel whose centre is at x or right of it.
  const auto first = [](double x) { return static_cast<int>(std::ceil(x - 0.5)); };
  std::vector<double> at;
  for (int y = std::max(first(top->y), 0); y < std::min(first(bottom->y), camera.height); ++y) {
    crossings(polygon, y + 0.5, at);
    for (std::size_t i = 0; i + 1 < at.size(); i += 2) {
      const int from = std::clamp(first(at[i]), 0, camera.width), to = std::clamp(first(at[i + 1]), from, camera.width);
      const auto row = mask.begin() + static_cast<std::ptrdiff_t>(y) * camera.width;
      std::fill(row + from, row + to, value);
    }
  }
}

}  // namespace

OrderedJson coco_categories() {
  return {{{"id", kCraterCategory}, {"name", "crater"}, {"supercategory", "landform"}},
          {{"id", kRockCategory}, {"name", "rock"}, {"supercategory", "landform"}}};
}

void FrameLabels::Mask::add(int x, int y, std::size_t at) {
  if (area == 0) left = right = x, top = bottom = y;
  if (area > 0 && at == past_last)
    ++runs.back();
  else
    runs.push_back(at - past_last), runs.push_back(1);
  past_last = at + 1, ++area;
  left = std::min(left, x), right = std::max(right, x), top = std::min(top, y), bottom = std::max(bottom, y);
}

std::size_t FrameLabels::pixels() const {
  return static_cast<std::size_t>(camera_.width) * static_cast<std::size_t>(camera_.height);
}

std::vector<FrameLabels::Mask> FrameLabels::masks_of_rocks() const {
  std::vector<Mask> masks(frame_.rocks.size());
  if (masks.empty()) return masks;
  std::size_t at = 0;
  for (int x = 0; x < camera_.width; ++x)
    for (int y = 0; y < camera_.height; ++y, ++at) {
      const std::uint16_t rock = frame_.products.rock[static_cast<std::size_t>(y) * camera_.width + x];
      if (rock < masks.size()) masks[rock].add(x, y, at);
    }
  return masks;
}

FrameLabels::FrameLabels(const engine::Frame& frame, const engine::Camera& camera, double least_px)
    : frame_(frame), camera_(camera) {
  constexpr double kLeastArea_px = 1e-3;
  for (const engine::CraterRim& rim : frame.report.craters.rims) {
    ImagePolygon polygon = in_image(rim.outline, camera.width, camera.height);
    if (const double area = area_of(polygon); polygon.size() >= 3 && area > kLeastArea_px)
      craters_.push_back({rim, std::move(polygon), area});
  }
  std::vector<Mask> masks = masks_of_rocks();
  for (std::size_t i = 0; i < masks.size(); ++i)
    if (masks[i].area > 0 && 4 * static_cast<double>(masks[i].area) >= std::numbers::pi * least_px * least_px)
      rocks_.push_back({i, std::move(masks[i])});
}

OrderedJson FrameLabels::annotation(const Crater& crater) {
  const engine::CraterRim& rim = crater.rim;
  OrderedJson flat = OrderedJson::array();
  for (const ImageCorner& c : crater.polygon) flat.push_back(c.x), flat.push_back(c.y);
  OrderedJson json{{"category_id", kCraterCategory},
                   {"bbox", box_of(crater.polygon)},
                   {"segmentation", OrderedJson::array({std::move(flat)})},
                   {"area", thousandths(crater.area)},
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

OrderedJson FrameLabels::annotation(const Rock& rock) const {
  const Mask& mask = rock.mask;
  const dem::RockFeature& feature = frame_.rocks[rock.number];
  std::vector<std::size_t> runs = mask.runs;
  if (mask.past_last < pixels()) runs.push_back(pixels() - mask.past_last);
  OrderedJson json{{"category_id", kRockCategory},
                   {"bbox", {mask.left, mask.top, mask.right - mask.left + 1, mask.bottom - mask.top + 1}},
                   {"segmentation", {{"size", {camera_.height, camera_.width}}, {"counts", std::move(runs)}}},
                   {"area", mask.area},
                   {"iscrowd", 0},
                   {"rock_id", id_text(feature.rock.id)}};
  for (const auto& column : rock_columns()) json[std::string(column.name)] = column.value(feature);
  return json;
}

OrderedJson FrameLabels::coco(const FrameQuery& query, const std::string& image) const {
  OrderedJson annotations = OrderedJson::array();
  const auto add = [&](const OrderedJson& members) {
    OrderedJson json{{"id", annotations.size() + 1}, {"image_id", 1}};
    json.update(members);
    annotations.push_back(std::move(json));
  };
  for (const Crater& crater : craters_) add(annotation(crater));
  for (const Rock& rock : rocks_) add(annotation(rock));
  return {{"info",
           {{"description", "Craters and rocks of a selenograph frame"},
            {"version", software_version()},
            {"detail", detail_metadata(query.detail, *query.request.detail)},
            {"request", resolved_json(query)}}},
          {"licenses", OrderedJson::array()},
          {"images", {{{"id", 1}, {"width", camera_.width}, {"height", camera_.height}, {"file_name", image}}}},
          {"categories", coco_categories()},
          {"annotations", std::move(annotations)}};
}

void FrameLabels::check_ids() const {
  constexpr std::size_t kMost = std::numeric_limits<std::uint16_t>::max();
  if (const std::size_t all = craters_.size() + rocks_.size(); all > kMost)
    throw RequestError(
        "invalid_request", "there are too many craters and rocks for masks",
        {{"/craters/smallest_px", fmt::format("the frame has {} craters and rocks of at least this size; "
                                              "masks can have {}",
                                              all, kMost)}});
}

std::vector<std::uint16_t> FrameLabels::crater_mask() const {
  check_ids();
  std::vector<std::uint16_t> mask(pixels(), 0);
  for (std::size_t i = 0; i < craters_.size(); ++i)
    fill(craters_[i].polygon, camera_, static_cast<std::uint16_t>(i + 1), mask);
  return mask;
}

std::vector<std::uint16_t> FrameLabels::rock_mask() const {
  check_ids();
  std::vector<std::uint16_t> ids(frame_.rocks.size(), 0), mask(pixels(), 0);
  for (std::size_t i = 0; i < rocks_.size(); ++i)
    ids[rocks_[i].number] = static_cast<std::uint16_t>(craters_.size() + i + 1);
  for (std::size_t i = 0; i < mask.size() && !ids.empty(); ++i)
    if (const std::uint16_t rock = frame_.products.rock[i]; rock < ids.size()) mask[i] = ids[rock];
  return mask;
}

}  // namespace selenograph::api
