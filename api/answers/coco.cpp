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
#include "api/message/version.h"
#include "api/requests/features_json.h"
#include "api/requests/parts/detail_json.h"

namespace selenograph::api {
namespace {

constexpr int kCraterCategory = 1, kRockCategory = 2;

// Returns a polygon clipped at a line: the part where `distance` of a corner is not negative (Sutherland & Hodgman
// 1974).
template <typename Distance>
ImagePolygon clipped(const ImagePolygon& polygon, const Distance& distance) {
  ImagePolygon inside;
  for (std::size_t i = 0; i < polygon.size(); ++i) {
    const ImageCorner &a = polygon[i], &b = polygon[(i + 1) % polygon.size()];
    const double distance_a = distance(a), distance_b = distance(b);
    if (distance_a >= 0) inside.push_back(a);
    if ((distance_a >= 0) == (distance_b >= 0)) continue;
    // The edge from a to b crosses the line at this fraction of its length, where the distance is 0.
    const double crossing = distance_a / (distance_a - distance_b);
    inside.push_back({std::lerp(a.x, b.x, crossing), std::lerp(a.y, b.y, crossing)});
  }
  return inside;
}

// Returns an outline in COCO's coordinates, clipped at the image's borders and rounded to 0.001 pixels. The engine's
// pixel centres are at whole numbers, COCO's half a pixel beyond.
ImagePolygon clip_to_image(const std::vector<engine::RimPoint>& outline, double width, double height) {
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

// Returns a polygon's area by the shoelace formula.
double area_of(const ImagePolygon& polygon) {
  double twice_area = 0;
  for (std::size_t i = 0; i < polygon.size(); ++i) {
    const ImageCorner &a = polygon[i], &b = polygon[(i + 1) % polygon.size()];
    twice_area += a.x * b.y - b.x * a.y;
  }
  return std::abs(twice_area) / 2;
}

// Returns a polygon's bounding box as COCO has it: x and y of the top-left corner, width, height.
OrderedJson box_of(const ImagePolygon& polygon) {
  ImageCorner min = polygon[0], max = polygon[0];
  for (const ImageCorner& c : polygon) {
    min = {std::min(min.x, c.x), std::min(min.y, c.y)};
    max = {std::max(max.x, c.x), std::max(max.y, c.y)};
  }
  return {min.x, min.y, thousandths(max.x - min.x), thousandths(max.y - min.y)};
}

// Sets `crossings_x` to the places where a polygon's border crosses the line y, from the left. The caller reuses the
// vector from row to row.
void find_crossings(const ImagePolygon& polygon, double y, std::vector<double>& crossings_x) {
  crossings_x.clear();
  for (std::size_t i = 0; i < polygon.size(); ++i) {
    const ImageCorner &a = polygon[i], &b = polygon[(i + 1) % polygon.size()];
    if ((a.y > y) != (b.y > y)) crossings_x.push_back(a.x + (y - a.y) / (b.y - a.y) * (b.x - a.x));
  }
  std::sort(crossings_x.begin(), crossings_x.end());
}

// Sets the pixels whose centres are in a polygon to a value: scan-line fill between pairs of crossings (even-odd rule).
void fill(const ImagePolygon& polygon, const engine::Camera& camera, std::uint16_t value,
          std::vector<std::uint16_t>& mask) {
  const auto [top, bottom] =
      std::minmax_element(polygon.begin(), polygon.end(), [](const auto& a, const auto& b) { return a.y < b.y; });
  // Returns the first pixel whose centre is at x or right of it.
  const auto first_pixel = [](double x) { return static_cast<int>(std::ceil(x - 0.5)); };
  std::vector<double> crossings_x;
  for (int y = std::max(first_pixel(top->y), 0); y < std::min(first_pixel(bottom->y), camera.height); ++y) {
    find_crossings(polygon, y + 0.5, crossings_x);
    for (std::size_t i = 0; i + 1 < crossings_x.size(); i += 2) {
      const int from = std::clamp(first_pixel(crossings_x[i]), 0, camera.width);
      const int to = std::clamp(first_pixel(crossings_x[i + 1]), from, camera.width);
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

// Once a pixel has been added, `runs` ends with a count of pixels inside. The next pixel extends it if it is adjacent;
// else it adds a count of pixels outside and a new one inside.
void FrameLabels::Mask::add(int x, int y, std::size_t index) {
  if (area == 0) {
    left = right = x;
    top = bottom = y;
  }
  if (area > 0 && index == past_last) {
    ++runs.back();
  } else {
    runs.push_back(index - past_last);
    runs.push_back(1);
  }
  past_last = index + 1;
  ++area;
  left = std::min(left, x);
  right = std::max(right, x);
  top = std::min(top, y);
  bottom = std::max(bottom, y);
}

std::size_t FrameLabels::pixels() const {
  return static_cast<std::size_t>(camera_.width) * static_cast<std::size_t>(camera_.height);
}

// Visits the pixels in COCO's order, in which Mask::add() needs them.
std::vector<FrameLabels::Mask> FrameLabels::masks_of_rocks() const {
  std::vector<Mask> masks(frame_.rocks.size());
  if (masks.empty()) return masks;
  std::size_t index = 0;
  for (int x = 0; x < camera_.width; ++x)
    for (int y = 0; y < camera_.height; ++y, ++index) {
      const std::uint16_t rock = frame_.products.rock[static_cast<std::size_t>(y) * camera_.width + x];
      if (rock < masks.size()) masks[rock].add(x, y, index);
    }
  return masks;
}

FrameLabels::FrameLabels(const engine::Frame& frame, const engine::Camera& camera, double min_diameter_px)
    : frame_(frame), camera_(camera) {
  constexpr double kMinArea_px = 1e-3;
  for (const engine::CraterRim& rim : frame.report.craters.rims) {
    ImagePolygon polygon = clip_to_image(rim.outline, camera.width, camera.height);
    if (const double area = area_of(polygon); polygon.size() >= 3 && area > kMinArea_px)
      craters_.push_back({rim, std::move(polygon), area});
  }
  std::vector<Mask> masks = masks_of_rocks();
  for (std::size_t i = 0; i < masks.size(); ++i)
    // Compare the mask's area with that of a circle, pi / 4 d^2.
    if (masks[i].area > 0 &&
        4 * static_cast<double>(masks[i].area) >= std::numbers::pi * min_diameter_px * min_diameter_px)
      rocks_.push_back({i, std::move(masks[i])});
}

OrderedJson FrameLabels::annotation(const Crater& crater) {
  const engine::CraterRim& rim = crater.rim;
  OrderedJson coordinates = OrderedJson::array();  // x0, y0, x1, y1, ..
  for (const ImageCorner& c : crater.polygon) {
    coordinates.push_back(c.x);
    coordinates.push_back(c.y);
  }
  OrderedJson json{{"category_id", kCraterCategory},
                   {"bbox", box_of(crater.polygon)},
                   {"segmentation", OrderedJson::array({std::move(coordinates)})},
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
  // The counts of a run-length encoding add up to all pixels: append those behind the last one inside.
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
  constexpr std::size_t kMaxId = std::numeric_limits<std::uint16_t>::max();
  if (const std::size_t count = craters_.size() + rocks_.size(); count > kMaxId)
    throw RequestError(
        "invalid_request", "there are too many craters and rocks for masks",
        {{"/craters/smallest_px", fmt::format("the frame has {} craters and rocks of at least this size; "
                                              "masks can have {}",
                                              count, kMaxId)}});
}

std::vector<std::uint16_t> FrameLabels::crater_mask() const {
  check_ids();
  std::vector<std::uint16_t> mask(pixels(), 0);
  // Fill from the largest to the smallest, so that smaller craters overwrite larger ones.
  for (std::size_t i = 0; i < craters_.size(); ++i)
    fill(craters_[i].polygon, camera_, static_cast<std::uint16_t>(i + 1), mask);
  return mask;
}

std::vector<std::uint16_t> FrameLabels::rock_mask() const {
  check_ids();
  // Annotation ids by the rock's number in the frame; 0 for a rock too small to be listed.
  std::vector<std::uint16_t> id_of_rock(frame_.rocks.size(), 0), mask(pixels(), 0);
  for (std::size_t i = 0; i < rocks_.size(); ++i)
    id_of_rock[rocks_[i].number] = static_cast<std::uint16_t>(craters_.size() + i + 1);
  for (std::size_t i = 0; i < mask.size() && !id_of_rock.empty(); ++i)
    if (const std::uint16_t rock = frame_.products.rock[i]; rock < id_of_rock.size()) mask[i] = id_of_rock[rock];
  return mask;
}

}  // namespace selenograph::api
