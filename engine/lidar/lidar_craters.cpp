#include "engine/lidar/lidar_craters.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <unordered_map>

#include "dem/base/error.h"
#include "dem/base/parallel.h"
#include "dem/detail/footprints.h"
#include "engine/frame/needs.h"

namespace selenograph::engine {
namespace {

// Returns the box of degrees around the points. Its east border is larger than its west border, so it may exceed 180.
// Empty if there is no point.
std::optional<dem::Footprint> box_around(const std::vector<Vec3>& points_m) {
  dem::Footprint box{90, -90, 1e9, -1e9};
  std::optional<double> first_lon_deg;  // longitudes are unwrapped around that of the first point
  for (const Vec3& point_m : points_m) {
    if (std::isnan(point_m.x())) continue;
    const Geographic g = to_geographic(point_m);
    if (!first_lon_deg) first_lon_deg = g.lon_deg;
    const double lon_deg = *first_lon_deg + wrap_lon_deg(g.lon_deg - *first_lon_deg);
    box.south_deg = std::min(box.south_deg, g.lat_deg);
    box.north_deg = std::max(box.north_deg, g.lat_deg);
    box.west_deg = std::min(box.west_deg, lon_deg);
    box.east_deg = std::max(box.east_deg, lon_deg);
  }
  if (!first_lon_deg) return std::nullopt;
  const double west_deg = wrap_lon_deg(box.west_deg);
  box.east_deg += west_deg - box.west_deg;
  box.west_deg = west_deg;
  return box;
}

// Craters of one octave in a grid of cells in the tangent plane, each as wide as the largest crater. A crater is stored
// in the 3 x 3 cells around its centre, so that a look-up reads one cell:
//
//   +---+---+---+
//   |   | .-+-. |   o: centre. The rim reaches at most 0.6 of a cell from it.
//   +---+-|-o-|-+
//   |   | '-+-' |
//   +---+---+---+
class CraterCells {
 public:
  CraterCells(const EastNorthUp& axes, double largest_m) : axes_(axes), cell_m_(largest_m) {}
  void add(const dem::Crater& crater) {
    const auto [x, y] = cell_of(crater.centre);
    for (int i = -1; i <= 1; ++i)
      for (int j = -1; j <= 1; ++j) cells_[key(x + i, y + j)].push_back(crater);
  }
  // Returns the smallest crater whose rim encloses a point in direction `up`, or null.
  const dem::Crater* smallest_around(const Vec3& up) const {
    const auto [x, y] = cell_of(up);
    const auto found = cells_.find(key(x, y));
    if (found == cells_.end()) return nullptr;
    const dem::Crater* smallest = nullptr;
    for (const dem::Crater& crater : found->second) {
      const bool inside = dem::round_radii(crater, up) <= 1;
      if (inside && (!smallest || crater.diameter_m < smallest->diameter_m)) smallest = &crater;
    }
    return smallest;
  }

 private:
  std::pair<std::int64_t, std::int64_t> cell_of(const Vec3& up) const {
    return {std::llround(kMoonRadius_m * up.dot(axes_.east) / cell_m_),
            std::llround(kMoonRadius_m * up.dot(axes_.north) / cell_m_)};
  }
  static std::int64_t key(std::int64_t x, std::int64_t y) { return x * (std::int64_t{1} << 32) + y; }

  EastNorthUp axes_;
  double cell_m_;
  std::unordered_map<std::int64_t, std::vector<dem::Crater>> cells_;
};

}  // namespace

std::vector<std::uint64_t> find_enclosing_craters(const std::vector<Vec3>& points_m, const LidarCraters& options,
                                                  const dem::CraterSurvey& survey, const StopToken& stop) {
  std::vector<std::uint64_t> ids(points_m.size(), 0);
  const auto box = box_around(points_m);
  if (!box) return ids;
  const dem::CraterField& field = survey.field();
  const auto is_large_enough = [&](const dem::Crater& crater) { return crater.diameter_m >= options.smallest_m; };
  const EastNorthUp axes = local_axes((box->south_deg + box->north_deg) / 2, (box->west_deg + box->east_deg) / 2);
  // Search the octaves from the smallest: the first crater found for a point is its smallest.
  for (int octave = field.smallest_octave(); octave <= field.largest_octave(); ++octave) {
    if (field.largest_m(octave) < options.smallest_m) continue;
    const dem::Footprint region = dem::around(*box, field.largest_m(octave) / 2);
    const double smallest_m = std::max(options.smallest_m, field.largest_m(octave) / 2);
    if (const double number = dem::expected_craters(field, region, smallest_m); number > kMaxCraters)
      throw ImpossibleRequest(fmt::format("there are some {:.0f} craters of {:g} m and more around what the beams met; "
                                          "up to {} are looked through: a larger smallest_m is needed",
                                          number, smallest_m, kMaxCraters),
                              "craters");
    const auto boxes = dem::cut(region, std::ldexp(dem::CraterSurvey::kBoxDiameters, octave));
    const auto craters =
        gathered_in_parallel<dem::CraterFeature>(boxes.size(), 4, [&](std::size_t i, auto& craters_in_box) {
          survey.craters_in(octave, boxes[i], options.least_depth, is_large_enough, craters_in_box, stop);
        });
    CraterCells cells(axes, field.largest_m(octave));
    for (const dem::CraterFeature& feature : craters) cells.add(feature.crater);
    in_parallel_pieces(points_m.size(), 4096, [&](std::size_t first, std::size_t past_last) {
      stop.check();
      for (std::size_t i = first; i < past_last; ++i)
        if (ids[i] == 0 && !std::isnan(points_m[i].x()))
          if (const dem::Crater* crater = cells.smallest_around(points_m[i].normalized())) ids[i] = crater->id;
    });
  }
  return ids;
}

}  // namespace selenograph::engine
