#include "api/answers/labels.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <utility>

#include "api/answers/crater_answer.h"
#include "api/json/ranges.h"
#include "api/message/problem.h"
#include "api/requests/features_json.h"

namespace selenograph::api {
namespace {

// A point of the image, whose top-left corner is (0, 0) and whose first pixel has its centre at (0.5, 0.5).
struct ImageCorner {
  double x, y;
};
using ImagePolygon = std::vector<ImageCorner>;  // closed

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

// Returns an outline clipped at the image's borders and rounded to 0.001 pixels. The engine's pixel centres are at
// whole numbers, those of ImageCorner half a pixel beyond.
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

// Returns the polygon of each crater's rim in the image; empty where none of it is there.
std::vector<ImagePolygon> polygons_of(const std::vector<engine::CraterRim>& rims, const engine::Camera& camera) {
  constexpr double kMinArea_px = 1e-3;
  std::vector<ImagePolygon> polygons;
  polygons.reserve(rims.size());
  for (const engine::CraterRim& rim : rims) {
    ImagePolygon& polygon = polygons.emplace_back(clip_to_image(rim.outline, camera.width, camera.height));
    if (polygon.size() < 3 || area_of(polygon) <= kMinArea_px) polygon.clear();
  }
  return polygons;
}

// Returns which of the frame's rocks cover at least as many pixels as a circle of diameter `min_diameter_px`.
std::vector<bool> find_large_rocks(const engine::Frame& frame, double min_diameter_px) {
  std::vector<std::size_t> pixels(frame.rocks.size(), 0);
  for (const std::uint16_t rock : frame.products.rock)
    if (rock < pixels.size()) ++pixels[rock];
  std::vector<bool> is_large;
  is_large.reserve(pixels.size());
  for (const std::size_t count : pixels)
    is_large.push_back(count > 0 &&
                       4 * static_cast<double>(count) >= std::numbers::pi * min_diameter_px * min_diameter_px);
  return is_large;
}

void check_label_count(std::size_t count) {
  constexpr std::size_t kMaxId = std::numeric_limits<std::uint16_t>::max();
  if (count > kMaxId)
    throw RequestError(
        "invalid_request", "there are too many craters and rocks for masks",
        {{"/craters/smallest_px", fmt::format("the frame has {} craters and rocks of at least this size; "
                                              "masks can have {}",
                                              count, kMaxId)}});
}

}  // namespace

FrameLabels label_frame(const engine::Frame& frame, const engine::Camera& camera, double min_diameter_px) {
  const std::vector<ImagePolygon> polygons = polygons_of(frame.report.craters.rims, camera);
  const std::vector<bool> is_large = find_large_rocks(frame, min_diameter_px);
  check_label_count(static_cast<std::size_t>(std::ranges::count_if(polygons, [](const auto& p) { return !p.empty(); }) +
                                             std::ranges::count(is_large, true)));
  const std::vector<std::uint16_t> no_labels(std::size_t(camera.width) * std::size_t(camera.height), 0);
  FrameLabels labels{.crater_mask = no_labels, .rock_mask = no_labels, .crater_ids = {}, .rocks = {}};
  std::uint16_t last_id = 0;
  // Fill from the largest to the smallest, so that smaller craters overwrite larger ones.
  for (const ImagePolygon& polygon : polygons) {
    labels.crater_ids.push_back(polygon.empty() ? std::uint16_t{0} : ++last_id);
    if (!polygon.empty()) fill(polygon, camera, last_id, labels.crater_mask);
  }
  std::vector<std::uint16_t> rock_ids(is_large.size(), 0);
  for (std::size_t i = 0; i < is_large.size(); ++i) {
    if (!is_large[i]) continue;
    rock_ids[i] = ++last_id;
    labels.rocks.push_back({frame.rocks[i], last_id});
  }
  for (std::size_t i = 0; i < frame.products.rock.size(); ++i)
    if (const std::uint16_t rock = frame.products.rock[i]; rock < rock_ids.size()) labels.rock_mask[i] = rock_ids[rock];
  return labels;
}

const Answer<LabelledRock>& rock_answer() {
  static const auto answer = make_answer<LabelledRock>(
      "A rock in `rock_mask`: its number there, and its members in POST /v1/features.", [](Answer<LabelledRock>& a) {
        a.add("mask_id", schema::integer(1, 65535, "its pixels' value in `rock_mask`"),
              [](const LabelledRock& rock) { return rock.mask_id; });
        a.add("id", schema::text("the same in every answer"),
              [](const LabelledRock& rock) { return id_text(rock.feature.rock.id); });
        for (const auto& column : rock_columns())
          a.add(column.name.data(), schema::number(kAnyNumber, column.meaning),
                [value = column.value](const LabelledRock& rock) { return value(rock.feature); });
      });
  return answer;
}

}  // namespace selenograph::api
