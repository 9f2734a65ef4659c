#include "dem/posts/resolved_posts.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <map>
#include <variant>

#include "dem/base/error.h"
#include "dem/base/names.h"
#include "dem/gdal/raster.h"
#include "dem/posts/post_patch.h"

namespace selenograph::dem {
namespace {

constexpr int kMaxOctaves = 5;                 // spacings up to 2^5 posts
constexpr int kSide = (2 << kMaxOctaves) + 1;  // side of a sample square: room for one widest second difference
constexpr int kMaxSpacing = 1 << kMaxOctaves;  // widest spacing, posts

struct Mean {
  double sum = 0, count = 0;

  void add(double x) {
    sum += x;
    count += 1;
  }
  double value() const { return count > 0 ? sum / count : 0; }
};

// Statistics of second differences h(y - d) - 2 h(y) + h(y + d) along meridians, by distance d = 2^octave posts and,
// for d = 1, by row modulo each spacing. The two ways to measure are explained at measure_resolved_posts().
class SecondDifferences {
 public:
  // Adds a sample square of kSide x kSide heights, m. `first_row`: its first row in the file; it is counted from the
  // same origin in all files of a layer.
  void add(const std::vector<float>& square, std::int64_t first_row) {
    for (int octave = 0; octave <= kMaxOctaves; ++octave) {
      const int apart = 1 << octave;
      for (int y = apart; y + apart < kSide; ++y) add_row(square, octave, y, first_row + y);
    }
  }

  // Returns the spacing, in posts, of lines between which heights are interpolated linearly; 1 if there are none.
  // `step_m`: the step to which heights are rounded, here and below.
  // Between such lines second differences over one post come from steps of the heights alone; on the lines they are
  // larger. Finds whole numbers of posts.
  int kink_spacing(double step_m) const {
    int found = 1;
    for (int posts = 2; posts <= kMaxSpacing; ++posts)
      if (is_spacing_of_kinks(posts, step_m))
        found = posts;  // kinks at every 8th post also pass as kinks at every 2nd and 4th: keep the widest
    return found;
  }

  // Returns the spacing from the growth of second differences with distance: 1, 2, 4 ..; 0 if it cannot be measured.
  int spacing_by_growth(double step_m) const {
    // Highest exponent of resolved ground. With bicubic interpolation second differences grow by the square, in
    // practice by at least 1.5.
    constexpr double kSteepest = 1.45;
    constexpr double kSignal =
        0.25;  // minimum signal in steps squared: on gentle ground rounding errors are not independent
    const auto mean_m2 = [&](int octave) {
      const Mean& m = squares_[static_cast<std::size_t>(octave)];
      // Subtract the contribution of steps: 1/12 of the squared step for each height, times its squared weight (1 + 4 +
      // 1).
      return m.count < 1000 ? 0 : m.value() - 0.5 * step_m * step_m;
    };
    int first = 0;  // first octave whose differences exceed the rounding errors
    while (first < kMaxOctaves && !(mean_m2(first) > kSignal * step_m * step_m)) ++first;
    int last = first;  // octave of the widest interpolated distance
    while (last < kMaxOctaves && std::log2(mean_m2(last + 1) / mean_m2(last)) / 2 >= kSteepest) ++last;
    // Octaves below the first are hidden by steps: they are interpolated if the first measurable octave is.
    return last > first || first == 0 ? 1 << last : 0;
  }

 private:
  // Adds the differences centred on row `y` of a square, which is row `row` of the layer.
  void add_row(const std::vector<float>& square, int octave, int y, std::int64_t row) {
    Mean absolute;
    for (int x = 0; x < kSide; ++x) {
      const auto height_m = [&](int steps) {
        return static_cast<double>(square[static_cast<std::size_t>((y + steps * (1 << octave)) * kSide + x)]);
      };
      const double d = height_m(-1) - 2 * height_m(0) + height_m(1);
      if (std::isnan(d)) continue;
      squares_[static_cast<std::size_t>(octave)].add(d * d);
      absolute.add(std::abs(d));
    }
    if (octave > 0) return;
    for (int posts = 2; posts <= kMaxSpacing; ++posts) {
      const std::int64_t phase = (row % posts + posts) % posts;
      Mean& rows = rows_[static_cast<std::size_t>(posts)][static_cast<std::size_t>(phase)];
      rows.sum += absolute.sum;
      rows.count += absolute.count;
    }
  }

  // Returns true if second differences are concentrated on one row modulo `posts`.
  bool is_spacing_of_kinks(int posts, double step_m) const {
    std::vector<double> means;
    for (int phase = 0; phase < posts; ++phase) {
      const Mean& rows = rows_[static_cast<std::size_t>(posts)][static_cast<std::size_t>(phase)];
      if (rows.count < 1000) return false;
      means.push_back(rows.value());
    }
    std::sort(means.begin(), means.end());
    // The median row lies between the lines, the row with the largest mean on them.
    const double between = means[(means.size() - 1) / 2], on_lines = means.back() - between;
    double excess = 0;  // of all rows: a single line should have most of it
    for (const double mean : means) excess += std::max(mean - between, 0.0);
    // Steps alone give a mean of 0.5 steps, less on gentle ground, where steps form patterns.
    const bool steps_alone = between - 0.6 * step_m < 0.25 * on_lines, gentle = between < 0.45 * step_m;
    return steps_alone && !gentle && on_lines > 0.1 * between && on_lines > 0.6 * excess;
  }

  std::array<Mean, kMaxOctaves + 1> squares_;  // squared second differences by octave
  // Absolute second differences over one post, by spacing and by row modulo the spacing.
  std::array<std::array<Mean, kMaxSpacing>, kMaxSpacing + 1> rows_;
};

// Returns the row of a file's first post, counted from an origin common to all files of a layer. Grids half a post
// apart get the same origin.
std::int64_t first_row(const RasterInfo& info) {
  const auto* degrees = std::get_if<GeographicGrid>(&info.grid);
  const auto* plane = std::get_if<PlaneGrid>(&info.grid);
  const double row =
      degrees ? (90 - degrees->first_lat_deg) * degrees->lat_posts_per_degree : -plane->first_y_m / plane->spacing_m;
  return static_cast<std::int64_t>(std::floor(row + 0.25));
}

}  // namespace

NamedNumber parse_resolved_posts(const std::string& text) {
  return parse_named_number(text, {"POSTS", 1, kMaxSpacing});
}

// Samples squares of posts, spread over the files. Kinks of linear interpolation decide if there are any, else growth.
int measure_resolved_posts(const Catalogue& catalogue, const std::vector<int>& files) {
  SecondDifferences differences;
  double step_m = 0;
  std::vector<float> square(std::size_t{kSide} * kSide);
  constexpr int kSquares = 64;
  const int sampled_files = std::min(static_cast<int>(files.size()), kSquares);
  for (int i = 0; i < sampled_files; ++i) {
    const RasterInfo& info = catalogue.rasters()[static_cast<std::size_t>(files[static_cast<std::size_t>(i)])];
    if (info.width < kSide || info.height < kSide) continue;
    step_m = std::max(step_m, info.quantisation_m);
    Raster raster(info);
    for (int k = i; k < kSquares; k += sampled_files) {
      // Choose the squares by an additive recurrence: evenly spread, and the same at every start.
      const double a = std::fmod(0.5 + k * 0.7548776662466927, 1.0), b = std::fmod(0.5 + k * 0.5698402909980532, 1.0);
      const int x = static_cast<int>(a * (info.width - kSide)), y = static_cast<int>(b * (info.height - kSide));
      raster.read(x, y, kSide, kSide, square.data());
      keep_ground(square, 0);
      differences.add(square, first_row(info) + y);
    }
  }
  const int kink_spacing = differences.kink_spacing(step_m);
  return kink_spacing > 1 ? kink_spacing : differences.spacing_by_growth(step_m);
}

std::vector<ResolvedLayer> resolve_posts(Catalogue& catalogue, const std::vector<NamedNumber>& settings) {
  std::vector<ResolvedLayer> measured;
  LayerJoins joins = catalogue.joins();
  joins.resolved_posts.assign(catalogue.rasters().size(), 1);
  for (const NamedNumber& setting : settings) {
    std::map<int, std::vector<int>> layers;  // files by the index of their layer's first file
    for (int file = 0; file < static_cast<int>(catalogue.rasters().size()); ++file)
      if (name_matches(catalogue.rasters()[static_cast<std::size_t>(file)].path, setting.pattern))
        layers[catalogue.layer_begin(file)].push_back(file);
    if (layers.empty()) throw DataError(setting.pattern, "no DEM file has such a name (--resolved-posts)");
    for (const auto& [first, files] : layers) {
      if (!setting.value) measured.push_back({files.front(), measure_resolved_posts(catalogue, files)});
      for (const int file : files)
        joins.resolved_posts[static_cast<std::size_t>(file)] =
            setting.value ? *setting.value : std::max(measured.back().posts, 1);
    }
  }
  catalogue.join_layers(std::move(joins));
  return measured;
}

}  // namespace selenograph::dem
