#include "dem/terrain/height_survey.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <mutex>
#include <vector>

#include "dem/base/error.h"
#include "dem/base/parallel.h"
#include "dem/gdal/raster.h"
#include "dem/pyramid/chunk_format.h"

namespace selenograph::dem {
namespace {

// The stencils of coarser levels and the filling of voids look beyond a block's border.
constexpr double kStencils = 3.0 / 64;  // of the block's size: three posts of its own level
constexpr int kPostsBeyond = kFillReach + 8;
constexpr double kFarNorth_deg = 80;  // beyond it blocks are wider and poles are filled
constexpr std::size_t kManyLayers = 16;

struct Area {
  double south_deg, north_deg, west_deg, east_deg;
};

struct Survey {
  HeightRange range{std::numeric_limits<float>::max(), std::numeric_limits<float>::lowest()};
  float steepest_m = 0;  // between neighbours in a row or column
  void add(const Survey& other) {
    range.low = std::min(range.low, other.range.low), range.high = std::max(range.high, other.range.high);
    steepest_m = std::max(steepest_m, other.steepest_m);
  }
};

struct Window {
  int x0 = 0, y0 = 0, columns = 0, rows = 0;
};

// The file's posts in an area and around it. Without columns or rows: there are none.
Window window_of(const RasterInfo& info, const Area& area) {
  const auto& grid = std::get<GeographicGrid>(info.grid);
  const PostXY corner = locate(info, area.north_deg, area.west_deg);
  const double east = corner.x + (area.east_deg - area.west_deg) * grid.lon_posts_per_degree,
               south = corner.y + (area.north_deg - area.south_deg) * grid.lat_posts_per_degree;
  const auto place = [](double post, int beyond, int most) {
    return static_cast<int>(std::clamp(std::floor(post) + beyond, 0.0, static_cast<double>(most)));
  };
  Window w;
  w.y0 = place(corner.y, -kPostsBeyond, info.height);
  w.rows = place(south, kPostsBeyond + 1, info.height) - w.y0;
  if (info.wraps_longitude) {  // reads past either end go on at the other one
    w.x0 = static_cast<int>(std::floor(corner.x)) - kPostsBeyond;
    w.columns = static_cast<int>(std::ceil(east - corner.x)) + 2 * kPostsBeyond + 1;
  } else {
    w.x0 = place(corner.x, -kPostsBeyond, info.width);
    w.columns = place(east, kPostsBeyond + 1, info.width) - w.x0;
  }
  return w;
}

Survey survey_of(const PostSource& source, int raster, const Window& w, const StopToken& stop) {
  // Fewer, where rows are long.
  constexpr std::size_t kMostRows = 64, kMostPosts = std::size_t{1} << 23;
  const std::size_t strip_rows =
      std::clamp<std::size_t>(kMostPosts / static_cast<std::size_t>(std::max(w.columns, 1)), 1, kMostRows);
  Survey found;
  std::mutex mutex;
  in_parallel_pieces((static_cast<std::size_t>(w.rows) + strip_rows - 1) / strip_rows, 1,
                     [&](std::size_t first, std::size_t past) {
                       Survey here;
                       std::vector<float> posts;
                       for (std::size_t strip = first; strip < past; ++strip) {
                         stop.check();
                         // With the next strip's first row.
                         const int y = static_cast<int>(strip * strip_rows),
                                   rows = std::min(static_cast<int>(strip_rows) + 1, w.rows - y);
                         posts.resize(static_cast<std::size_t>(rows) * static_cast<std::size_t>(w.columns));
                         source.read(raster, w.x0, w.y0 + y, w.columns, rows, posts.data());
                         for (int r = 0; r < rows; ++r) {
                           const float* row = posts.data() + static_cast<std::ptrdiff_t>(r) * w.columns;
                           extend_range(row, w.columns, here.range);
                           here.steepest_m = largest_distance(row, row + 1, w.columns - 1, here.steepest_m);
                           if (r > 0)
                             here.steepest_m = largest_distance(row - w.columns, row, w.columns, here.steepest_m);
                         }
                       }
                       const std::lock_guard lock(mutex);
                       found.add(here);
                     });
  return found;
}

bool easy(const RasterInfo& info) {
  if (!info.damage.empty() || info.projection() != Projection::geographic) return false;
  if (info.on_network) return false;  // a network's time is worth more than ours
  return info.wraps_longitude || info.footprint.east_deg - info.footprint.west_deg < 180;
}

}  // namespace

std::optional<HeightRange> survey_heights(const Catalogue& catalogue, const PostSource& source, const BlockId& block,
                                          const StopToken& stop) {
  const BlockExtent e = extent_of(block);
  Area area{lat_deg_of(e.lat0), lat_deg_of(e.lat1()), static_cast<double>(e.lon0) / kTicksPerDegree - 180,
            static_cast<double>(e.lon1()) / kTicksPerDegree - 180};
  const double beyond_lat = kStencils * (area.north_deg - area.south_deg),
               beyond_lon = kStencils * (area.east_deg - area.west_deg);
  area = {area.south_deg - beyond_lat, area.north_deg + beyond_lat, area.west_deg - beyond_lon,
          area.east_deg + beyond_lon};
  if (std::max(-area.south_deg, area.north_deg) > kFarNorth_deg) return std::nullopt;
  const std::vector<int> layers = catalogue.touching(area.south_deg, area.north_deg, area.west_deg, area.east_deg, 0);
  if (layers.empty() || layers.size() > kManyLayers) return std::nullopt;
  Survey found;
  bool resampled = false;
  int finest = 0;
  for (const int layer : layers)
    finest = std::max(finest, level_needed(catalogue.rasters()[static_cast<std::size_t>(layer)]));
  try {
    for (const int layer : layers) {
      const RasterInfo& info = catalogue.rasters()[static_cast<std::size_t>(layer)];
      if (!easy(info)) return std::nullopt;
      resampled |= !info.lattice_level || *info.lattice_level < finest;
      const Window window = window_of(info, area);
      if (window.columns > 1 && window.rows > 0) found.add(survey_of(source, layer, window, stop));
    }
  } catch (const DataError&) {
    return std::nullopt;  // who needs the file's posts will say so
  } catch (const SystemFault&) {
    return std::nullopt;
  }
  if (found.range.low > found.range.high) return std::nullopt;
  // A cubic kernel and the slopes that posts are extended by reach beyond the posts by less than twice the largest step
  // between neighbours. Each octave is rounded to its own step.
  float slack = 2 * found.steepest_m;
  if (resampled && layers.size() > 1) slack = std::max(slack, found.range.high - found.range.low);  // across a gap
  slack += 2 * static_cast<float>(format::height_step_m(block.level));
  return HeightRange{std::max(found.range.low - slack, kLowestRelief_m),
                     std::min(found.range.high + slack, kHighestRelief_m)};
}

HeightRange sampled_heights(const RasterInfo& info, std::size_t posts) {
  Raster raster(info);
  const int rows = std::clamp(static_cast<int>(posts / static_cast<std::size_t>(info.width)), 1, info.height);
  std::vector<float> row(static_cast<std::size_t>(info.width));
  HeightRange range = Survey().range;
  for (int i = 0; i < rows; ++i) {
    raster.read(0, static_cast<int>((2LL * i + 1) * info.height / (2LL * rows)), info.width, 1, row.data());
    extend_range(row.data(), info.width, range);
  }
  return range;
}

}  // namespace selenograph::dem
