// The Moon without relief, as tiles and a renderer: every hit of a ray has a formula.
#pragma once

#include <gtest/gtest.h>

#include <cmath>
#include <cstddef>
#include <optional>

#include "dem/terrain/terrain.h"
#include "engine/renderer.h"
#include "tests/support/float_tiles.h"
#include "tests/support/shared_data.h"

namespace selenograph::test {

// The chords of the finest mesh (level 8) lie at most this far below the sphere.
constexpr double kFinestSag_m = 0.0021;

class MoonWithoutRelief : public ::testing::Test {
 protected:
  static void SetUpTestSuite() {
    folder_ = new TemporaryFolder;
    write_global_tile(folder_->path(), 1, [](double, double) { return 0.0; });
    renderer_ = new engine::Renderer(open_terrain(folder_->path()), {1, std::size_t{512} << 20});
  }
  static void TearDownTestSuite() {
    delete renderer_;
    delete folder_;
    renderer_ = nullptr;
    folder_ = nullptr;
  }
  static const engine::Renderer& renderer() { return *renderer_; }

 private:
  static inline TemporaryFolder* folder_ = nullptr;
  static inline engine::Renderer* renderer_ = nullptr;
};

// Returns the distance along a unit direction to a sphere `sag_m` below that of the Moon; empty if the ray misses it.
inline std::optional<double> meet_sphere(const Vec3& from, const Vec3& direction, double sag_m) {
  const double radius = kMoonRadius_m - sag_m, b = from.dot(direction), c = from.squared_norm() - radius * radius;
  const double discriminant = b * b - c;
  if (b >= 0 || discriminant < 0) return std::nullopt;
  return c / (-b + std::sqrt(discriminant));  // the smaller root without cancellation
}

}  // namespace selenograph::test
