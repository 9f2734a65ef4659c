#include "dem/posts/resolved_posts.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <map>

#include "dem/gdal/raster.h"
#include "dem/support/error.h"

namespace selenograph::dem {
namespace {

constexpr int kMostOctaves = 5, kSide = (2 << kMostOctaves) + 1;
constexpr double kSteepest = 1.5;  // the power of what is resolved

// Mean squares of second differences over 1, 2, 4 .. posts.
class SecondDifferences {
 public:
  void add(const std::vector<float>& square) {
    for (std::size_t octave = 0; octave < squares_.size(); ++octave) {
      const int apart = 1 << octave;
      for (int y = apart; y + apart < kSide; ++y)
        for (int x = 0; x < kSide; ++x) {
          const auto at = [&](int row) {
            return static_cast<double>(square[static_cast<std::size_t>(row * kSide + x)]);
          };
          const double d = at(y - apart) - 2 * at(y) + at(y + apart);
          if (std::isnan(d)) continue;
          squares_[octave].sum += d * d, squares_[octave].count += 1;
        }
    }
  }
  // Less what steps of heights add: a twelfth of their square for each height, by its weight's square.
  double mean_m2(std::size_t octave, double step_m) const {
    const Mean& m = squares_[octave];
    return m.count < 1000 ? 0 : m.sum / m.count - 0.5 * step_m * step_m;
  }

 private:
  struct Mean {
    double sum = 0, count = 0;
  };
  std::array<Mean, kMostOctaves + 1> squares_;
};

}  // namespace

NamedNumber parse_resolved_posts(const std::string& text) {
  return parse_named_number(text, {"POSTS", 1, 1 << kMostOctaves});
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
      raster.read(static_cast<int>(a * (info.width - kSide)), static_cast<int>(b * (info.height - kSide)), kSide, kSide,
                  square.data());
      differences.add(square);
    }
  }
  int octaves = 0;
  for (; octaves < kMostOctaves; ++octaves) {
    const auto k = static_cast<std::size_t>(octaves);
    const double near_m2 = differences.mean_m2(k, step_m), far_m2 = differences.mean_m2(k + 1, step_m);
    if (!(near_m2 > 0 && far_m2 > 0) || std::log2(far_m2 / near_m2) / 2 < kSteepest) break;
  }
  return 1 << octaves;
}

std::vector<ResolvedLayer> resolve_posts(Catalogue& catalogue, const std::vector<NamedNumber>& settings) {
  std::vector<ResolvedLayer> measured;
  LayerJoins joins = catalogue.joins();
  joins.resolved_posts.assign(catalogue.rasters().size(), 1);
  for (const NamedNumber& setting : settings) {
    std::map<int, std::vector<int>> layers;  // by their first file
    for (int file = 0; file < static_cast<int>(catalogue.rasters().size()); ++file)
      if (matches(catalogue.rasters()[static_cast<std::size_t>(file)], setting.pattern))
        layers[catalogue.layer_begin(file)].push_back(file);
    if (layers.empty()) throw DataError(setting.pattern, "no DEM file has such a name (--resolved-posts)");
    for (const auto& [first, files] : layers) {
      if (!setting.value) measured.push_back({files.front(), measured_resolved_posts(catalogue, files)});
      for (const int file : files)
        joins.resolved_posts[static_cast<std::size_t>(file)] = setting.value ? *setting.value : measured.back().posts;
    }
  }
  catalogue.join_layers(std::move(joins));
  return measured;
}

}  // namespace selenograph::dem
