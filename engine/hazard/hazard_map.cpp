#include "engine/hazard/hazard_map.h"

#include <fmt/format.h>

#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <utility>
#include <vector>

#include "dem/grid/block.h"
#include "dem/support/error.h"
#include "dem/support/parallel.h"
#include "engine/hazard/footprint.h"
#include "engine/hazard/ground_window.h"
#include "engine/support/assign.h"

namespace selenograph::engine {
namespace {

constexpr ProductSet kOfFootprint = kRockCover | kRoughness | kHazard;
constexpr float kNaN32 = std::numeric_limits<float>::quiet_NaN();

// Pixels beyond the map's border that footprints cover, by the map's scale at nine of its places. Throws
// ImpossibleRequest. It takes a while: who knows what was drawn has it from there.
int margin_px(const MapRequest& request) {
  constexpr int kMost_px = 200;
  const dem::MapGrid& grid = request.grid;
  int margin = 1;
  for (const int y : {0, grid.height / 2, grid.height - 1})
    for (const int x : {0, grid.width / 2, grid.width - 1}) {
      const auto footprint =
          footprint_on_map(*request.footprint, grid, x, y, static_cast<double>(dem::kLowestRelief_m));
      if (footprint) margin = std::max(margin, footprint->reach_px() + 1);
    }
  if (margin > kMost_px)
    throw ImpossibleRequest(
        fmt::format("the footprint reaches {} pixels from its middle, at most {}: ask for a larger gsd_m", margin,
                    kMost_px),
        "footprint");
  return margin;
}

int margin_px(const MapRequest& request, const MapRequest& drawn) {
  return (drawn.grid.width - request.grid.width) / 2;
}

// In work: squares of pixels that share one footprint, so small that the map's scale is the same all over them. Where
// north turns, next to a pole, they are smaller.
constexpr int kSquare_px = 128;

class HazardMap {
 public:
  HazardMap(const MapRequest& request, const MapRequest& drawn, FrameProducts& products, const StopToken& stop)
      : request_(request), drawn_(drawn), products_(products), stop_(stop), margin_(margin_px(request, drawn)) {
    const std::size_t n = static_cast<std::size_t>(drawn.grid.width) * static_cast<std::size_t>(drawn.grid.height);
    const auto allocate = [&](auto& array, ProductSet product, auto none) {
      if (request.products & product) assign(array, n, none, stop);
    };
    allocate(products.slope, kSlope, kNaN32), allocate(products.roughness, kRoughness, kNaN32);
    allocate(products.rock_cover, kRockCover, kNaN32), allocate(products.hazard, kHazard, kNoHazardNumber);
  }

  void find() {
    const int across = (request_.grid.width + kSquare_px - 1) / kSquare_px,
              along = (request_.grid.height + kSquare_px - 1) / kSquare_px;
    in_parallel(static_cast<std::size_t>(across * along), [&](std::size_t i) {
      stop_.check();
      const int x = static_cast<int>(i) % across * kSquare_px, y = static_cast<int>(i) / across * kSquare_px;
      find(x + margin_, y + margin_, std::min(kSquare_px, request_.grid.width - x),
           std::min(kSquare_px, request_.grid.height - y));
    });
  }

 private:
  std::size_t index(int x, int y) const {
    return static_cast<std::size_t>(y) * static_cast<std::size_t>(drawn_.grid.width) + static_cast<std::size_t>(x);
  }

  std::optional<FootprintOnMap> footprint_at(int x, int y) const {
    const double height_m = products_.height[index(x, y)];
    return footprint_on_map(*request_.footprint, drawn_.grid, x, y, std::isnan(height_m) ? 0 : height_m);
  }

  // Whether no part of the footprint is another pixel elsewhere because it is turned. A disc may turn.
  bool same_at(int x, int y, const FootprintOnMap& middle) const {
    if (request_.footprint->shape == LanderFootprint::Shape::disc) return true;
    const auto here = footprint_at(x, y);
    if (!here) return true;
    const Eigen::Matrix2d moved = here->metres_per_px.inverse() * middle.metres_per_px - Eigen::Matrix2d::Identity();
    return moved.norm() / std::numbers::sqrt2 * middle.reach_px() < 0.5;
  }

  // A square of the drawn map.
  void find(int x0, int y0, int width, int height) {
    const auto footprint = footprint_at(x0 + width / 2, y0 + height / 2);
    // Where the map is distorted far more than at its border and middle there is no answer.
    if (!footprint || footprint->rows.empty() || footprint->reach_px() > margin_) return;
    const int x1 = x0 + width - 1, y1 = y0 + height - 1;
    if ((x1 > x0 || y1 > y0) && !(same_at(x0, y0, *footprint) && same_at(x1, y0, *footprint) &&
                                  same_at(x0, y1, *footprint) && same_at(x1, y1, *footprint))) {
      const int left = (width + 1) / 2, upper = (height + 1) / 2;
      for (const auto& [y, rows] : {std::pair{y0, upper}, {y0 + upper, height - upper}})
        for (const auto& [x, columns] : {std::pair{x0, left}, {x0 + left, width - left}})
          if (rows > 0 && columns > 0) find(x, y, columns, rows);
      return;
    }
    const GroundWindow::Limits limits{request_.hazard.rock_height_m, roughness_above_m()};
    const GroundWindow ground(products_, drawn_.grid.width, drawn_.grid.height, {x0, y0, width, height}, *footprint,
                              limits);
    std::vector<FootprintMeasures> row(static_cast<std::size_t>(width));
    for (int y = 0; y < height; ++y) {
      if (y % 8 == 0) stop_.check();
      ground.measure(y, row);
      for (int x = 0; x < width; ++x) store(row[static_cast<std::size_t>(x)], index(x0 + x, y0 + y));
    }
  }

  // The mask alone asks for what is beyond its limit.
  std::optional<double> roughness_above_m() const {
    if (request_.products & kRoughness) return 0;
    return request_.products & kHazard ? request_.hazard.roughness_m : std::nullopt;
  }

  void store(const FootprintMeasures& of, std::size_t at) {
    if (std::isnan(of.slope_deg)) return;
    if (!products_.slope.empty()) products_.slope[at] = static_cast<float>(of.slope_deg);
    if (!products_.roughness.empty()) products_.roughness[at] = static_cast<float>(of.roughness_m);
    if (!products_.rock_cover.empty()) products_.rock_cover[at] = static_cast<float>(of.rock_cover);
    if (products_.hazard.empty()) return;
    const HazardLimits& limits = request_.hazard;
    int hazard = 0;
    if (limits.slope_deg && of.slope_deg > *limits.slope_deg) hazard |= kTooSteep;
    if (limits.roughness_m && of.roughness_m > *limits.roughness_m) hazard |= kTooRough;
    if (limits.rock_height_m && of.high_rocks > 0) hazard |= kRockTooHigh;
    if (limits.rock_cover && of.rock_cover > *limits.rock_cover) hazard |= kTooManyRocks;
    products_.hazard[at] = static_cast<std::uint16_t>(hazard);
  }

  const MapRequest& request_;
  const MapRequest& drawn_;
  FrameProducts& products_;
  const StopToken& stop_;
  int margin_;
};

// Without the border.
template <typename T>
void cut(std::vector<T>& array, const dem::MapGrid& drawn, const dem::MapGrid& asked, int margin) {
  const auto width = static_cast<std::size_t>(drawn.width), side = static_cast<std::size_t>(margin);
  const std::size_t channels = array.size() / (width * static_cast<std::size_t>(drawn.height));
  if (channels == 0) return;
  const auto length = static_cast<std::ptrdiff_t>(channels * static_cast<std::size_t>(asked.width));
  auto to = array.begin();
  for (std::size_t row = 0; row < static_cast<std::size_t>(asked.height); ++row) {
    const auto from = array.begin() + static_cast<std::ptrdiff_t>(channels * ((row + side) * width + side));
    to = std::copy(from, from + length, to);
  }
  array.erase(to, array.end());
}

}  // namespace

bool wants_footprint(const MapRequest& request) {
  return request.products & kOfFootprint || (request.footprint && request.products & kSlope);
}

MapRequest drawn_for(const MapRequest& request) {
  MapRequest drawn = request;
  const int margin = margin_px(request);
  drawn.grid.width += 2 * margin, drawn.grid.height += 2 * margin;
  drawn.grid.west_m -= margin * drawn.grid.gsd_m, drawn.grid.north_m += margin * drawn.grid.gsd_m;
  drawn.products &= ~static_cast<ProductSet>(kOfFootprint | kSlope);
  drawn.products |= kHeight | (request.rocks ? ProductSet{kRockHeight} : 0);
  drawn.footprint.reset();
  return drawn;
}

std::size_t bytes_of_footprints(const MapRequest& request, const MapRequest& drawn) {
  constexpr std::size_t kBytesOfPixel = 40, kThreads = 16;
  const auto side = static_cast<std::size_t>(kSquare_px + 2 * margin_px(request, drawn));
  return kThreads * kBytesOfPixel * side * side;
}

void find_hazards(const MapRequest& request, const MapRequest& drawn, FrameProducts& products, const StopToken& stop) {
  HazardMap(request, drawn, products, stop).find();
  if (!(request.products & kHeight)) products.height = {};
  if (!(request.products & kRockHeight)) products.rock_height = {};
  const int margin = margin_px(request, drawn);
  std::apply([&](auto&... array) { (cut(array, drawn.grid, request.grid, margin), ...); }, all_arrays(products));
}

}  // namespace selenograph::engine
