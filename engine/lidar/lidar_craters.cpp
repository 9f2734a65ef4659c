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

// The box of degrees around the places; east of its west border, past 180 if need be. Empty: no place.
std::optional<dem::Footprint> box_around(const std::vector<Vec3>& places) {
  dem::Footprint box{90, -90, 1e9, -1e9};
  std::optional<double> middle_deg;  // longitudes are taken near the first
  for (const Vec3& place : places) {
    if (std::isnan(place.x())) continue;
    const Geographic g = to_geographic(place);
    if (!middle_deg) middle_deg = g.lon_deg;
    const double lon_deg = *middle_deg + wrap_lon_deg(g.lon_deg - *middle_deg);
    box.south_deg = std::min(box.south_deg, g.lat_deg), box.north_deg = std::max(box.north_deg, g.lat_deg);
    box.west_deg = std::min(box.west_deg, lon_deg), box.east_deg = std::max(box.east_deg, lon_deg);
  }
  if (!middle_deg) return std::nullopt;
  const double west_deg = wrap_lon_deg(box.west_deg);
  box.east_deg += west_deg - box.west_deg, box.west_deg = west_deg;
  return box;
}

// Craters of an octave by the cells of a plane that they reach.
class CraterCells {
 public:
  CraterCells(const EastNorthUp& axes, double largest_m) : axes_(axes), cell_m_(largest_m) {}
  void add(const dem::Crater& crater) {
    const auto [x, y] = cell_of(crater.centre);
    for (int i = -1; i <= 1; ++i)
      for (int j = -1; j <= 1; ++j) cells_[key(x + i, y + j)].push_back(crater);
  }
  const dem::Crater* smallest_around(const Vec3& up) const {
    const auto [x, y] = cell_of(up);
    const auto found = cells_.find(key(x, y));
    if (found == cells_.end()) return nullptr;
    const dem::Crater* smallest = nullptr;
    for (const dem::Crater& crater : found->second) {
      const bool inside = (up - crater.centre).norm() * kMoonRadius_m <= crater.diameter_m / 2;
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
  double cell_m_;  // a rim reaches half of that from its centre: to the next cells
  std::unordered_map<std::int64_t, std::vector<dem::Crater>> cells_;
};

}  // namespace

std::vector<std::uint64_t> craters_of(const std::vector<Vec3>& places, const LidarCraters& options,
                                      const dem::CraterSurvey& survey, const StopToken& stop) {
  std::vector<std::uint64_t> ids(places.size(), 0);
  const auto box = box_around(places);
  if (!box) return ids;
  const dem::CraterField& field = survey.field();
  const auto wanted = [&](const dem::Crater& crater) { return crater.diameter_m >= options.smallest_m; };
  const EastNorthUp axes = local_axes((box->south_deg + box->north_deg) / 2, (box->west_deg + box->east_deg) / 2);
  // From the smallest on: what has found its crater needs no larger one.
  for (int octave = field.smallest_octave(); octave <= field.largest_octave(); ++octave) {
    if (field.largest_m(octave) < options.smallest_m) continue;
    const dem::Footprint region = dem::around(*box, field.largest_m(octave) / 2);
    const double smallest_m = std::max(options.smallest_m, field.largest_m(octave) / 2);
    if (const double number = dem::expected_craters(field, region, smallest_m); number > kMostCraters)
      throw ImpossibleRequest(fmt::format("there are some {:.0f} craters of {:g} m and more around what the beams met; "
                                          "up to {} are looked through: a larger smallest_m is needed",
                                          number, smallest_m, kMostCraters),
                              "craters");
    const auto pieces = dem::cut(region, std::ldexp(dem::CraterSurvey::kBoxDiameters, octave));
    const auto craters = gathered_in_parallel<dem::CraterFeature>(pieces.size(), 4, [&](std::size_t i, auto& some) {
      survey.craters_in(octave, pieces[i], options.least_depth, wanted, some, stop);
    });
    CraterCells cells(axes, field.largest_m(octave));
    for (const dem::CraterFeature& feature : craters) cells.add(feature.crater);
    in_parallel_pieces(places.size(), 4096, [&](std::size_t first, std::size_t past_last) {
      stop.check();
      for (std::size_t i = first; i < past_last; ++i)
        if (ids[i] == 0 && !std::isnan(places[i].x()))
          if (const dem::Crater* crater = cells.smallest_around(places[i].normalized())) ids[i] = crater->id;
    });
  }
  return ids;
}

}  // namespace selenograph::engine
