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

namespace selenograph::dem {
namespace {

constexpr int kMostOctaves = 5, kSide = (2 << kMostOctaves) + 1, kWidestApart = 1 << kMostOctaves;

struct Mean {
  double sum = 0, count = 0;

  void add(double x) { sum += x, count += 1; }
  double value() const { return count > 0 ? sum / count : 0; }
};

// Second differences along meridians.
class SecondDifferences {
 public:
  // `first_row`: counted from the same place in all files of a layer.
  void add(const std::vector<float>& square, std::int64_t first_row) {
    for (int octave = 0; octave <= kMostOctaves; ++octave) {
      const int apart = 1 << octave;
      for (int y = apart; y + apart < kSide; ++y) add_row(square, octave, y, first_row + y);
    }
  }

  // The spacing of lines between which heights are interpolated linearly; 1: there are none. There second differences
  // over one post are but steps of heights, and on the lines more. Finds whole numbers of posts.
  int kinks(double step_m) const {
    int found = 1;
    for (int posts = 2; posts <= kWidestApart; ++posts)
      if (is_spacing_of_kinks(posts, step_m)) found = posts;  // those of 8 posts look like such of 2 and 4, too
    return found;
  }

  // From their growth: 1, 2, 4 ..; 0: can't be measured.
  int by_growth(double step_m) const {
    // Of resolved ground they grow by less than this power; interpolated by bicubics, with the square, by 1.5 at least.
    constexpr double kSteepest = 1.45;
    constexpr double kSignal = 0.25;  // steps squared: on gentle ground their errors are not independent
    const auto mean_m2 = [&](int octave) {
      const Mean& m = squares_[static_cast<std::size_t>(octave)];
      // Less what steps add: a twelfth of their square for each height, by its weight's square.
      return m.count < 1000 ? 0 : m.value() - 0.5 * step_m * step_m;
    };
    int first = 0;
    while (first < kMostOctaves && !(mean_m2(first) > kSignal * step_m * step_m)) ++first;
    int last = first;
    while (last < kMostOctaves && std::log2(mean_m2(last + 1) / mean_m2(last)) / 2 >= kSteepest) ++last;
    // What steps hide below the first is interpolated if the first is.
    return last > first || first == 0 ? 1 << last : 0;
  }

 private:
  void add_row(const std::vector<float>& square, int octave, int y, std::int64_t row) {
    Mean absolute;
    for (int x = 0; x < kSide; ++x) {
      const auto at = [&](int r) {
        return static_cast<double>(square[static_cast<std::size_t>((y + r * (1 << octave)) * kSide + x)]);
      };
      const double d = at(-1) - 2 * at(0) + at(1);
      if (std::isnan(d)) continue;
      squares_[static_cast<std::size_t>(octave)].add(d * d);
      absolute.add(std::abs(d));
    }
    if (octave > 0) return;
    for (int posts = 2; posts <= kWidestApart; ++posts) {
      const std::int64_t phase = (row % posts + posts) % posts;
      Mean& rows = rows_[static_cast<std::size_t>(posts)][static_cast<std::size_t>(phase)];
      rows.sum += absolute.sum, rows.count += absolute.count;
    }
  }

  bool is_spacing_of_kinks(int posts, double step_m) const {
    std::vector<double> means;
    for (int phase = 0; phase < posts; ++phase) {
      const Mean& rows = rows_[static_cast<std::size_t>(posts)][static_cast<std::size_t>(phase)];
      if (rows.count < 1000) return false;
      means.push_back(rows.value());
    }
    std::sort(means.begin(), means.end());
    const double between = means[(means.size() - 1) / 2], on_lines = means.back() - between;
    double all = 0;
    for (const double mean : means) all += std::max(mean - between, 0.0);
    // Steps alone make 0.5 in the mean, less on gentle ground, where they lie in patterns.
    const bool steps_alone = between - 0.6 * step_m < 0.25 * on_lines, gentle = between < 0.45 * step_m;
    return steps_alone && !gentle && on_lines > 0.1 * between && on_lines > 0.6 * all;
  }

  std::array<Mean, kMostOctaves + 1> squares_;
  std::array<std::array<Mean, kWidestApart>, kWidestApart + 1>
      rows_;  // absolute ones over one post, by row modulo posts
};

// Of its first post, in posts: the same place for all files of a layer, and of posts that are half a post beside it.
std::int64_t first_row(const RasterInfo& info) {
  const auto* degrees = std::get_if<GeographicGrid>(&info.grid);
  const auto* plane = std::get_if<PlaneGrid>(&info.grid);
  const double row =
      degrees ? (90 - degrees->first_lat_deg) * degrees->lat_posts_per_degree : -plane->first_y_m / plane->spacing_m;
  return static_cast<std::int64_t>(std::floor(row + 0.25));
}

}  // namespace

NamedNumber parse_resolved_posts(const std::string& text) {
  return parse_named_number(text, {"POSTS", 1, kWidestApart});
}

int measured_resolved_posts(const Catalogue& catalogue, const std::vector<int>& files) {
  SecondDifferences differences;
  double step_m = 0;
  std::vector<float> square(std::size_t{kSide} * kSide);
  constexpr int kSquares = 64;
  const int some = std::min(static_cast<int>(files.size()), kSquares);
  for (int i = 0; i < some; ++i) {
    const RasterInfo& info = catalogue.rasters()[static_cast<std::size_t>(files[static_cast<std::size_t>(i)])];
    if (info.width < kSide || info.height < kSide) continue;
    step_m = std::max(step_m, info.quantisation_m);
    Raster raster(info);
    for (int k = i; k < kSquares; k += some) {
      // Places by an additive recurrence: even, and the same at every start.
      const double a = std::fmod(0.5 + k * 0.7548776662466927, 1.0), b = std::fmod(0.5 + k * 0.5698402909980532, 1.0);
      const int x = static_cast<int>(a * (info.width - kSide)), y = static_cast<int>(b * (info.height - kSide));
      raster.read(x, y, kSide, kSide, square.data());
      differences.add(square, first_row(info) + y);
    }
  }
  const int kinks = differences.kinks(step_m);
  return kinks > 1 ? kinks : differences.by_growth(step_m);
}

std::vector<ResolvedLayer> resolve_posts(Catalogue& catalogue, const std::vector<NamedNumber>& settings) {
  std::vector<ResolvedLayer> measured;
  LayerJoins joins = catalogue.joins();
  joins.resolved_posts.assign(catalogue.rasters().size(), 1);
  for (const NamedNumber& setting : settings) {
    std::map<int, std::vector<int>> layers;  // by their first file
    for (int file = 0; file < static_cast<int>(catalogue.rasters().size()); ++file)
      if (name_matches(catalogue.rasters()[static_cast<std::size_t>(file)].path, setting.pattern))
        layers[catalogue.layer_begin(file)].push_back(file);
    if (layers.empty()) throw DataError(setting.pattern, "no DEM file has such a name (--resolved-posts)");
    for (const auto& [first, files] : layers) {
      if (!setting.value) measured.push_back({files.front(), measured_resolved_posts(catalogue, files)});
      for (const int file : files)
        joins.resolved_posts[static_cast<std::size_t>(file)] =
            setting.value ? *setting.value : std::max(measured.back().posts, 1);
    }
  }
  catalogue.join_layers(std::move(joins));
  return measured;
}

}  // namespace selenograph::dem
