#include "engine/hazard/hazard_map.h"

#include <fmt/format.h>

#include <algorithm>
#include <atomic>
#include <cmath>
#include <numbers>
#include <utility>
#include <vector>

#include "dem/base/error.h"
#include "dem/base/parallel.h"
#include "dem/grid/block.h"
#include "engine/hazard/footprint.h"
#include "engine/hazard/ground_window.h"
#include "engine/support/assign.h"

namespace selenograph::engine {
namespace {

constexpr ProductSet kFootprintOnly = kRockCover | kRoughness | kHazard;

// Returns the map's scale at a pixel with the lowest possible ground, where a footprint covers most pixels; empty off
// the Moon.
std::optional<Mat2> lowest_scale(const MapRequest& request, int column, int row) {
  return metres_per_px(request.grid, column, row, static_cast<double>(dem::kLowestRelief_m));
}

// Returns the largest footprint reach up to a limit over a map that ends at the limb or contains a pole. Such a map may
// be stretched without bounds, and its extreme scales need not be at its corners, so a grid of points is sampled.
double largest_reach_px(const MapRequest& request, double limit_px) {
  constexpr int kSteps = 64;
  double largest_px = 0;
  for (int y = 0; y < kSteps; ++y)
    for (int x = 0; x < kSteps; ++x) {
      const auto scale = lowest_scale(request, x * request.grid.width / kSteps, y * request.grid.height / kSteps);
      const double reach_px = scale ? reach_upper_bound_px(*request.footprint, *scale) : 0;
      if (reach_px <= limit_px) largest_px = std::max(largest_px, reach_px);
    }
  return largest_px;
}

// Returns the margin that footprints cover beyond the map's border, from the map's scale at nine points and, if one of
// these is off the Moon, at a grid of points. Throws ImpossibleRequest for footprints that reach too far. Slow: once
// the map is drawn, use the overload below.
int margin_px(const MapRequest& request) {
  constexpr double kMax_px = 200, kMaxNearLimb_px = 50;
  const dem::MapGrid& grid = request.grid;
  double margin = 1;
  bool is_partial = false;
  for (const int y : {0, grid.height / 2, grid.height - 1})
    for (const int x : {0, grid.width / 2, grid.width - 1}) {
      const auto scale = lowest_scale(request, x, y);
      is_partial = is_partial || !scale;
      if (!scale) continue;
      // The exact reach takes time in proportion to the footprint: skip it where the bound is so large that the request
      // is refused anyway. One pixel more allows for scales between the sampled points.
      const double reach_px = reach_upper_bound_px(*request.footprint, *scale);
      margin = std::max(
          margin, reach_px > 2 * kMax_px ? reach_px : footprint_on_map(*request.footprint, *scale).reach_px() + 1);
    }
  if (margin > kMax_px)
    throw ImpossibleRequest(
        fmt::format("the footprint reaches {:.0f} pixels from its middle, at most {:.0f}: ask for a larger gsd_m",
                    margin, kMax_px),
        "footprint");
  if (is_partial)
    margin = std::max(margin, largest_reach_px(request, std::min(kMax_px, std::max(kMaxNearLimb_px, 2 * margin))));
  return static_cast<int>(margin);
}

// Returns the margin of a drawn map.
int margin_px(const MapRequest& request, const MapRequest& drawn) {
  return (drawn.grid.width - request.grid.width) / 2;
}

// Side of the squares of pixels that share one footprint. A square is halved until the map's scale is the same all over
// it: next to a pole or the limb, where north turns or the map is stretched.
constexpr int kSquare_px = 128;
// Largest relative error of lengths in a square, and so of slopes, at which its scale counts as the same.
constexpr double kMaxScaleError = 0.02;

// Computes the footprint's products for all pixels of the requested map, square by square in parallel.
class HazardMap {
 public:
  HazardMap(const MapRequest& request, const MapRequest& drawn, FrameProducts& products, const StopToken& stop)
      : request_(request), drawn_(drawn), products_(products), stop_(stop), margin_(margin_px(request, drawn)) {
    const std::size_t n = static_cast<std::size_t>(drawn.grid.width) * static_cast<std::size_t>(drawn.grid.height);
    // Fills requested products with their value for pixels without data.
    const auto allocate = [&](auto& array, ProductSet product, auto no_data) {
      if (request.products & product) assign(array, n, no_data, stop);
    };
    allocate(products.slope, kSlope, kNaN32);
    allocate(products.roughness, kRoughness, kNaN32);
    allocate(products.rock_cover, kRockCover, kNaN32);
    allocate(products.hazard, kHazard, kNoHazardNumber);
  }

  // Measures all pixels. Returns how many pixels with ground have no plane because of the map's scale.
  std::size_t measure_all() {
    const int squares_per_row = (request_.grid.width + kSquare_px - 1) / kSquare_px,
              rows_of_squares = (request_.grid.height + kSquare_px - 1) / kSquare_px;
    in_parallel(static_cast<std::size_t>(squares_per_row * rows_of_squares), [&](std::size_t i) {
      stop_.check();
      const int x = static_cast<int>(i) % squares_per_row * kSquare_px,
                y = static_cast<int>(i) / squares_per_row * kSquare_px;
      measure_or_divide(x + margin_, y + margin_, std::min(kSquare_px, request_.grid.width - x),
                        std::min(kSquare_px, request_.grid.height - y));
    });
    return without_plane_;
  }

 private:
  std::size_t index(int x, int y) const {
    return static_cast<std::size_t>(y) * static_cast<std::size_t>(drawn_.grid.width) + static_cast<std::size_t>(x);
  }

  std::optional<Mat2> scale_at(int x, int y) const {
    const double height_m = products_.height[index(x, y)];
    return metres_per_px(drawn_.grid, x, y, std::isnan(height_m) ? 0 : height_m);
  }

  // Returns the footprint at a pixel. Empty off the Moon, and if the footprint reaches beyond the drawn margin, because
  // the map is stretched more there than at the sampled points.
  std::optional<FootprintOnMap> footprint_at(int x, int y) const {
    const auto scale = scale_at(x, y);
    if (!scale || reach_upper_bound_px(*request_.footprint, *scale) > 2.0 * (margin_ + 1)) return std::nullopt;
    auto footprint = footprint_on_map(*request_.footprint, *scale);
    return footprint.reach_px() > margin_ ? std::nullopt : std::optional(std::move(footprint));
  }

  // Returns true if the footprint of a square's centre holds at a pixel of it: the scale is the same, and no pixel of
  // the footprint moves by half a pixel. A disc may rotate.
  bool same_at(int x, int y, const FootprintOnMap& middle) const {
    const auto scale = scale_at(x, y);
    if (!scale) return false;
    // `deformation` takes metres at the middle to metres here for equal offsets in pixels. Its strain (Green-Lagrange)
    // does not count rotation.
    const Mat2 identity = Mat2::identity();
    const Mat2 deformation = *scale * middle.metres_per_px.inverse();
    const Mat2 strain = (deformation.transpose() * deformation - identity) / 2;
    if (!(strain.norm() < kMaxScaleError)) return false;
    const double shift_per_px = (scale->inverse() * middle.metres_per_px - identity).norm();
    const bool is_disc = request_.footprint->shape == LanderFootprint::Shape::disc;
    return (is_disc ? strain.norm() : shift_per_px) / std::numbers::sqrt2 * middle.reach_px() < 0.5;
  }

  std::size_t pixels_with_ground(int x0, int y0, int width, int height) const {
    std::size_t n = 0;
    for (int y = y0; y < y0 + height; ++y)
      for (int x = x0; x < x0 + width; ++x) n += !std::isnan(products_.height[index(x, y)]);
    return n;
  }

  // Measures a square of the drawn map, or its quarters if its pixels cannot share one footprint.
  void measure_or_divide(int x0, int y0, int width, int height) {
    const auto footprint = footprint_at(x0 + width / 2, y0 + height / 2);
    const int x1 = x0 + width - 1, y1 = y0 + height - 1;
    const bool is_pixel = x1 == x0 && y1 == y0;
    if (footprint && (is_pixel || (same_at(x0, y0, *footprint) && same_at(x1, y0, *footprint) &&
                                   same_at(x0, y1, *footprint) && same_at(x1, y1, *footprint))))
      return measure(x0, y0, width, height, *footprint);
    const std::size_t ground = pixels_with_ground(x0, y0, width, height);
    if (ground == 0) return;
    if (is_pixel) {
      without_plane_ += ground;
      return;
    }
    const int left = (width + 1) / 2, upper = (height + 1) / 2;
    for (const auto& [y, rows] : {std::pair{y0, upper}, {y0 + upper, height - upper}})
      for (const auto& [x, columns] : {std::pair{x0, left}, {x0 + left, width - left}})
        if (rows > 0 && columns > 0) measure_or_divide(x, y, columns, rows);
  }

  // Measures a square whose pixels share one footprint.
  void measure(int x0, int y0, int width, int height, const FootprintOnMap& footprint) {
    const GroundWindow::Limits limits{request_.hazard.rock_height_m, min_roughness_m()};
    const GroundWindow ground(products_, drawn_.grid.width, drawn_.grid.height, {x0, y0, width, height}, footprint,
                              limits);
    if (!ground.has_planes()) {
      without_plane_ += pixels_with_ground(x0, y0, width, height);
      return;
    }
    std::vector<FootprintMeasures> row(static_cast<std::size_t>(width));
    for (int y = 0; y < height; ++y) {
      if (y % 8 == 0) stop_.check();
      ground.measure(y, row);
      for (int x = 0; x < width; ++x) store(row[static_cast<std::size_t>(x)], index(x0 + x, y0 + y));
    }
  }

  // Returns the roughness above which it must be exact. If only the mask needs roughness, that is the mask's limit.
  std::optional<double> min_roughness_m() const {
    if (request_.products & kRoughness) return 0;
    return request_.products & kHazard ? request_.hazard.roughness_m : std::nullopt;
  }

  // Writes a pixel's products and its mask. Pixels without data keep NaN and kNoHazardNumber.
  void store(const FootprintMeasures& measures, std::size_t pixel) {
    if (std::isnan(measures.slope_deg)) return;
    if (!products_.slope.empty()) products_.slope[pixel] = static_cast<float>(measures.slope_deg);
    if (!products_.roughness.empty()) products_.roughness[pixel] = static_cast<float>(measures.roughness_m);
    if (!products_.rock_cover.empty()) products_.rock_cover[pixel] = static_cast<float>(measures.rock_cover);
    if (products_.hazard.empty()) return;
    const HazardLimits& limits = request_.hazard;
    int hazard = 0;
    if (limits.slope_deg && measures.slope_deg > *limits.slope_deg) hazard |= kTooSteep;
    if (limits.roughness_m && measures.roughness_m > *limits.roughness_m) hazard |= kTooRough;
    if (limits.rock_height_m && measures.high_rocks > 0) hazard |= kRockTooHigh;
    if (limits.rock_cover && measures.rock_cover > *limits.rock_cover) hazard |= kTooManyRocks;
    products_.hazard[pixel] = static_cast<std::uint16_t>(hazard);
  }

  const MapRequest& request_;
  const MapRequest& drawn_;
  FrameProducts& products_;
  const StopToken& stop_;
  int margin_;                                  // of the drawn map on each side, pixels
  std::atomic<std::size_t> without_plane_ = 0;  // pixels with ground
};

// Cuts the margin off an array of pixels with one or more channels.
template <typename T>
void cut(std::vector<T>& array, const dem::MapGrid& drawn, const dem::MapGrid& requested, int margin) {
  const auto width = static_cast<std::size_t>(drawn.width), side = static_cast<std::size_t>(margin);
  const std::size_t channels = array.size() / (width * static_cast<std::size_t>(drawn.height));
  if (channels == 0) return;
  const auto length = static_cast<std::ptrdiff_t>(channels * static_cast<std::size_t>(requested.width));
  auto to = array.begin();
  for (std::size_t row = 0; row < static_cast<std::size_t>(requested.height); ++row) {
    const auto from = array.begin() + static_cast<std::ptrdiff_t>(channels * ((row + side) * width + side));
    to = std::copy(from, from + length, to);
  }
  array.erase(to, array.end());
}

}  // namespace

bool wants_footprint(const MapRequest& request) {
  return request.products & kFootprintOnly || (request.footprint && request.products & kSlope);
}

MapRequest request_with_margin(const MapRequest& request) {
  MapRequest drawn = request;
  const int margin = margin_px(request);
  drawn.grid.width += 2 * margin;
  drawn.grid.height += 2 * margin;
  drawn.grid.west_m -= margin * drawn.grid.gsd_m;
  drawn.grid.north_m += margin * drawn.grid.gsd_m;
  drawn.products &= ~static_cast<ProductSet>(kFootprintOnly | kSlope);
  drawn.products |= kHeight | (request.rocks ? ProductSet{kRockHeight} : 0);
  drawn.footprint.reset();
  return drawn;
}

std::size_t bytes_of_footprints(const MapRequest& request, const MapRequest& drawn) {
  constexpr std::size_t kBytesPerPixel = 40, kThreads = 16;
  const auto side = static_cast<std::size_t>(kSquare_px + 2 * margin_px(request, drawn));
  return kThreads * kBytesPerPixel * side * side;
}

std::vector<std::string> find_hazards(const MapRequest& request, const MapRequest& drawn, FrameProducts& products,
                                      const StopToken& stop) {
  const std::size_t without_plane = HazardMap(request, drawn, products, stop).measure_all();
  if (!(request.products & kHeight)) products.height = {};
  if (!(request.products & kRockHeight)) products.rock_height = {};
  const int margin = margin_px(request, drawn);
  std::apply([&](auto&... array) { (cut(array, drawn.grid, request.grid, margin), ...); }, all_arrays(products));
  if (without_plane == 0) return {};
  return {fmt::format(
      "{} pixels with ground have no plane of the footprint: there the map is stretched so that it covers less than "
      "three non-collinear pixels, or more than {} pixels from its middle, or it ends next to them",
      without_plane, margin)};
}

}  // namespace selenograph::engine
