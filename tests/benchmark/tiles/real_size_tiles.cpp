// Tiles of the size of Kaguya's, from coarser ones: their surface by a cubic kernel, and fractal relief between their
// posts. Sixteen as SLDEM2013 has them (1 degree, 4096 px/deg) in FOLDER/sldem2013, and one of the seamless set
// (3 degrees, 3600 px/deg) in FOLDER/seamless.
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdlib>
#include <exception>
#include <filesystem>
#include <string>

#include "dem/base/parallel.h"
#include "dem/catalogue/catalogue.h"
#include "dem/grid/geodesy.h"
#include "dem/posts/post_source.h"
#include "dem/sample/crater_profile.h"
#include "tests/support/tiles.h"

namespace {

using namespace selenograph;
namespace fs = std::filesystem;

constexpr int kSouth_deg = 24, kWest_deg = 2, kSide_deg = 4;
constexpr int kCoarseLevel = 8;  // 256 px/deg
constexpr int kCoarsePerDegree = 256;
constexpr int kMargin = 4;  // posts of context for the kernel

// Catmull-Rom weights of four posts around a place `t` beyond the second.
std::array<double, 4> weights(double t) {
  return {((2 - t) * t - 1) * t / 2, ((3 * t - 5) * t * t + 2) / 2, ((4 - 3 * t) * t + 1) * t / 2, (t - 1) * t * t / 2};
}

class Relief {
 public:
  explicit Relief(const std::string& folder) : catalogue_(std::vector{folder}) {
    window_.lat_step = window_.lon_step = 1 << (dem::kTickLevel - kCoarseLevel);
    window_.lat0 = std::int64_t{kSouth_deg + 90} * dem::kTicksPerDegree - kMargin * window_.lat_step;
    window_.lon0 = std::int64_t{kWest_deg + 180} * dem::kTicksPerDegree - kMargin * window_.lon_step;
    window_.rows = window_.cols = kSide_deg * kCoarsePerDegree + 1 + 2 * kMargin;
    const dem::PostSource source(catalogue_, false, [](const std::string&, const std::string&) {});
    posts_ = source.compose(window_);
    dem::PostSource::fill_voids(window_, posts_);
  }

  double height_m(double lat_deg, double lon_deg) const {
    return coarse_m(lat_deg, lon_deg) + detail_m(lat_deg, lon_deg);
  }

 private:
  double coarse_m(double lat_deg, double lon_deg) const {
    const double y = (lat_deg - kSouth_deg) * kCoarsePerDegree + kMargin,
                 x = (lon_deg - kWest_deg) * kCoarsePerDegree + kMargin;
    const int j = static_cast<int>(std::floor(y)), i = static_cast<int>(std::floor(x));
    const auto wy = weights(y - j), wx = weights(x - i);
    double sum = 0;
    for (std::size_t r = 0; r < 4; ++r)
      for (std::size_t c = 0; c < 4; ++c) {
        const std::size_t row = static_cast<std::size_t>(std::clamp(j - 1 + static_cast<int>(r), 0, window_.rows - 1)),
                          col = static_cast<std::size_t>(std::clamp(i - 1 + static_cast<int>(c), 0, window_.cols - 1));
        sum += wy[r] * wx[c] * static_cast<double>(posts_.heights[row * static_cast<std::size_t>(window_.cols) + col]);
      }
    return sum;
  }

  // Hurst exponent 0.9 from 256 m downward, metres between posts.
  static double detail_m(double lat_deg, double lon_deg) {
    const double north_m = lat_deg * kMetresPerDegree,
                 east_m = lon_deg * kMetresPerDegree * std::cos(26 * kRadiansPerDegree);
    double sum = 0;
    std::uint64_t seed = 1;
    for (double wave_m = 256; wave_m > 10; wave_m /= 2, ++seed)
      sum +=
          6 * std::pow(wave_m / 256, 0.9) * dem::sample::gradient_noise(east_m / wave_m, north_m / wave_m, 0.5, seed);
    return sum;
  }

  dem::Catalogue catalogue_;
  dem::PostWindow window_;
  dem::Posts posts_;
};

int run(const std::string& from, const std::string& to) {
  const Relief relief(from);
  const auto height = [&](double lat, double lon) { return relief.height_m(lat, lon); };
  constexpr std::size_t kTiles = kSide_deg * kSide_deg;
  in_parallel(kTiles + 1, [&](std::size_t i) {
    if (i == 0) {
      test::write_kaguya_tile(to + "/seamless", kSouth_deg + 3, kWest_deg, 3, 3600, height);
    } else {
      const int at = static_cast<int>(i) - 1;
      test::write_kaguya_tile(to + "/sldem2013", kSouth_deg + 1 + at / kSide_deg, kWest_deg + at % kSide_deg, 1, 4096,
                              height);
    }
  });
  return 0;
}

}  // namespace

int main(int argc, char** argv) {
  if (argc != 3) {
    fmt::print(stderr, "usage: {} FOLDER_OF_COARSER_TILES FOLDER\n  they cover 2..6 E, 24..28 N\n", argv[0]);
    return 2;
  }
  try {
    return run(argv[1], argv[2]);
  } catch (const std::exception& e) {
    fmt::print(stderr, "{}\n", e.what());
    return 1;
  }
}
