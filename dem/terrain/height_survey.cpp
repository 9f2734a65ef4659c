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

// Margins around a block: the stencils of coarser levels and the filling of voids read posts beyond its border.
constexpr double kStencilMargin = 3.0 / 64;  // share of the block's size: three posts of its own level
constexpr int kMarginPosts = kFillReach + 8;
constexpr double kMaxLat_deg = 80;  // nearer to a pole, blocks are wider and the pole is filled
constexpr std::size_t kMaxLayers = 16;

struct Area {
  double south_deg, north_deg, west_deg, east_deg;
};

struct Survey {
  HeightRange range{std::numeric_limits<float>::max(), std::numeric_limits<float>::lowest()};
  float steepest_m = 0;  // largest difference of adjacent posts in a row or column
  void add(const Survey& addend) {
    range.low = std::min(range.low, addend.range.low);
    range.high = std::max(range.high, addend.range.high);
    steepest_m = std::max(steepest_m, addend.steepest_m);
  }
};

// Columns and rows of a file.
struct Window {
  int x0 = 0, y0 = 0, columns = 0, rows = 0;
};

// Returns the file's posts in an area and its margin; no columns or rows if there are none.
Window window_of(const RasterInfo& info, const Area& area) {
  const auto& grid = std::get<GeographicGrid>(info.grid);
  const PostXY corner = locate(info, area.north_deg, area.west_deg);
  const double east = corner.x + (area.east_deg - area.west_deg) * grid.lon_posts_per_degree,
               south = corner.y + (area.north_deg - area.south_deg) * grid.lat_posts_per_degree;
  const auto clamped = [](double post, int margin, int size) {
    return static_cast<int>(std::clamp(std::floor(post) + margin, 0.0, static_cast<double>(size)));
  };
  Window w;
  w.y0 = clamped(corner.y, -kMarginPosts, info.height);
  w.rows = clamped(south, kMarginPosts + 1, info.height) - w.y0;
  if (info.wraps_longitude) {  // reads past one end continue at the other
    w.x0 = static_cast<int>(std::floor(corner.x)) - kMarginPosts;
    w.columns = static_cast<int>(std::ceil(east - corner.x)) + 2 * kMarginPosts + 1;
  } else {
    w.x0 = clamped(corner.x, -kMarginPosts, info.width);
    w.columns = clamped(east, kMarginPosts + 1, info.width) - w.x0;
  }
  return w;
}

// Surveys a window of one file, in strips of rows, in parallel.
Survey survey_of(const PostSource& source, int raster, const Window& w, const StopToken& stop) {
  // Bound the rows of a strip, and its memory where rows are long.
  constexpr std::size_t kMaxRows = 64, kMaxPosts = std::size_t{1} << 23;
  const std::size_t strip_rows =
      std::clamp<std::size_t>(kMaxPosts / static_cast<std::size_t>(std::max(w.columns, 1)), 1, kMaxRows);
  Survey found;
  std::mutex mutex;
  in_parallel_pieces((static_cast<std::size_t>(w.rows) + strip_rows - 1) / strip_rows, 1,
                     [&](std::size_t first, std::size_t past) {
                       Survey partial;
                       std::vector<float> posts;
                       for (std::size_t strip = first; strip < past; ++strip) {
                         stop.check();
                         // Include the next strip's first row, for differences across the strips.
                         const int y = static_cast<int>(strip * strip_rows),
                                   rows = std::min(static_cast<int>(strip_rows) + 1, w.rows - y);
                         posts.resize(static_cast<std::size_t>(rows) * static_cast<std::size_t>(w.columns));
                         source.read(raster, w.x0, w.y0 + y, w.columns, rows, posts.data());
                         for (int r = 0; r < rows; ++r) {
                           const float* row = posts.data() + static_cast<std::ptrdiff_t>(r) * w.columns;
                           extend_range(row, w.columns, partial.range);
                           partial.steepest_m = largest_distance(row, row + 1, w.columns - 1, partial.steepest_m);
                           if (r > 0)
                             partial.steepest_m = largest_distance(row - w.columns, row, w.columns, partial.steepest_m);
                         }
                       }
                       const std::lock_guard lock(mutex);
                       found.add(partial);
                     });
  return found;
}

// Returns whether a scan of the file gives bounds at a small cost.
bool is_easy(const RasterInfo& info) {
  if (!info.damage.empty() || info.projection() != Projection::geographic) return false;
  if (info.on_network) return false;  // reading it takes longer than building without bounds
  return info.wraps_longitude || info.footprint.east_deg - info.footprint.west_deg < 180;
}

}  // namespace

// Scans all files over the block and its margin; the range of their posts, widened by what interpolation may overshoot,
// bounds the block and everything below it.
std::optional<HeightRange> survey_heights(const Catalogue& catalogue, const PostSource& source, const BlockId& block,
                                          const StopToken& stop) {
  const BlockExtent e = extent_of(block);
  Area area{lat_deg_of(e.lat0), lat_deg_of(e.lat1()), static_cast<double>(e.lon0) / kTicksPerDegree - 180,
            static_cast<double>(e.lon1()) / kTicksPerDegree - 180};
  const double lat_margin_deg = kStencilMargin * (area.north_deg - area.south_deg),
               lon_margin_deg = kStencilMargin * (area.east_deg - area.west_deg);
  area = {area.south_deg - lat_margin_deg, area.north_deg + lat_margin_deg, area.west_deg - lon_margin_deg,
          area.east_deg + lon_margin_deg};
  if (std::max(-area.south_deg, area.north_deg) > kMaxLat_deg) return std::nullopt;
  const std::vector<int> layers = catalogue.touching(area.south_deg, area.north_deg, area.west_deg, area.east_deg, 0);
  if (layers.empty() || layers.size() > kMaxLayers) return std::nullopt;
  Survey found;
  bool resampled = false;  // a file's posts are interpolated at the block's finest posts
  int finest = 0;          // finest level that a file needs
  for (const int layer : layers)
    finest = std::max(finest, level_needed(catalogue.rasters()[static_cast<std::size_t>(layer)]));
  try {
    for (const int layer : layers) {
      const RasterInfo& info = catalogue.rasters()[static_cast<std::size_t>(layer)];
      if (!is_easy(info)) return std::nullopt;
      resampled |= !info.lattice_level || *info.lattice_level < finest;
      const Window window = window_of(info, area);
      if (window.columns > 1 && window.rows > 0) found.add(survey_of(source, layer, window, stop));
    }
  } catch (const DataError&) {
    return std::nullopt;  // the caller that needs the file's posts reports it
  } catch (const SystemFault&) {
    return std::nullopt;
  }
  if (found.range.low > found.range.high) return std::nullopt;
  // Widen the range: a cubic kernel, and the slopes by which posts are extrapolated, overshoot the posts by less than
  // twice the largest difference of neighbours. Add the rounding of each octave to its own step.
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
