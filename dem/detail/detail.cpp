#include "dem/detail/detail.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

#include "dem/lattice.h"

namespace selenograph::dem {
namespace {

constexpr double kPostsPerFeature = 4;

// The ball around a grid's places.
struct Around {
  Vec3 direction;
  double radius_m;
};
Around around(const DirectionGrid& grid) {
  const auto place = [&](std::size_t r, std::size_t c) {
    return Vec3(grid.cos_lat[r] * grid.cos_lon[c], grid.cos_lat[r] * grid.sin_lon[c], grid.sin_lat[r]);
  };
  const std::size_t rows = grid.rows(), columns = grid.columns();
  Around out{place(rows / 2, columns / 2), 0};
  // Of a grid that is no wider than a quarter of the globe the farthest is on its border.
  const auto reach = [&](std::size_t r, std::size_t c) {
    out.radius_m = std::max(out.radius_m, (place(r, c) - out.direction).norm() * kMoonRadius_m);
  };
  for (std::size_t r = 0; r < rows; ++r) reach(r, 0), reach(r, columns - 1);
  for (std::size_t c = 0; c < columns; ++c) reach(0, c), reach(rows - 1, c);
  return out;
}

}  // namespace

int Detail::smallest_octave(int level) {
  return static_cast<int>(std::ceil(std::log2(kPostsPerFeature * post_spacing_m(level)) - 1e-9));
}

Detail::Detail(const DetailPreset& preset) : preset_(preset), craters_(preset.craters), relief_(preset.relief) {
  // The mean over many places of the octave alone. Places by an additive recurrence: the same on every machine.
  constexpr int kSide = 192;
  for (int octave = craters_.smallest_octave(); octave <= craters_.largest_octave(); ++octave) {
    std::array<std::vector<double>, 4> table;
    for (auto& t : table) t.resize(kSide);
    // A square of 64 diameters at the equator, where a grid is square.
    const double step = std::ldexp(64.0, octave) / kSide / kMoonRadius_m;
    for (int i = 0; i < kSide; ++i) {
      const auto n = static_cast<std::size_t>(i);
      table[0][n] = std::sin(i * step), table[1][n] = std::cos(i * step);
      table[2][n] = std::sin(1 + i * step), table[3][n] = std::cos(1 + i * step);
    }
    std::vector<double> heights(kSide * kSide);
    means_m_.push_back(0);
    add_craters({table[0], table[1], table[2], table[3]}, octave, heights);
    double sum = 0;
    for (const double h : heights) sum += h;
    means_m_.back() = sum / (kSide * kSide);
  }
}

int Detail::finest_level() const {
  int level = 0;
  const auto shows = [&](int smallest, int largest) {
    return smallest > largest || smallest_octave(level) <= smallest;
  };
  while (level < kMaxLevel && !(shows(craters_.smallest_octave(), craters_.largest_octave()) &&
                                shows(relief_.shortest_octave(), relief_.longest_octave())))
    ++level;
  return level;
}

double Detail::mean_m(int octave) const {
  return means_m_[static_cast<std::size_t>(octave - craters_.smallest_octave())];
}

double Detail::left_out_m(int level, int posts_level) const {
  double sum = 0;
  const int shown = std::min(smallest_octave(level), smallest_octave(posts_level));
  for (int k = craters_.smallest_octave(); k <= std::min(shown - 1, craters_.largest_octave()); ++k)
    sum += std::max(craters_.deepest_m(k) + mean_m(k), craters_.highest_m(k) - mean_m(k));
  for (int k = relief_.shortest_octave(); k <= std::min(shown - 1, relief_.longest_octave()); ++k)
    sum += relief_.most_m(k);
  return sum;
}

void Detail::add_craters(const DirectionGrid& grid, int octave, std::span<double> heights_m) const {
  const std::size_t rows = grid.rows(), columns = grid.columns();
  const Around all = around(grid);
  std::vector<Crater> craters;
  craters_.near(octave, all.direction, all.radius_m, craters);
  std::vector<double> cavity(rows * columns, 0.0), rim(rows * columns, 0.0);
  const CraterShape& shape = craters_.shape();
  for (const Crater& crater : craters) {
    const double reach = crater.reach_m() / kMoonRadius_m, reach2 = reach * reach,
                 per_radius = kMoonRadius_m / (crater.diameter_m / 2);
    for (std::size_t r = 0; r < rows; ++r) {
      const double dz = grid.sin_lat[r] - crater.centre.z();
      // A chord is at least as long as its part along the axis.
      if (dz * dz > reach2) continue;
      for (std::size_t c = 0; c < columns; ++c) {
        const double dx = grid.cos_lat[r] * grid.cos_lon[c] - crater.centre.x(),
                     dy = grid.cos_lat[r] * grid.sin_lon[c] - crater.centre.y();
        const double distance2 = dx * dx + dy * dy + dz * dz;
        if (distance2 >= reach2) continue;
        const double h = crater.scale * shape.height(std::sqrt(distance2) * per_radius, crater.age);
        const std::size_t at = r * columns + c;
        cavity[at] = std::min(cavity[at], h), rim[at] = std::max(rim[at], h);
      }
    }
  }
  const double mean = mean_m(octave);
  for (std::size_t i = 0; i < heights_m.size(); ++i) heights_m[i] += cavity[i] + rim[i] - mean;
}

void Detail::add(const DirectionGrid& grid, int level, int posts_level, std::span<double> heights_m) const {
  const int shown = smallest_octave(level), of_posts = smallest_octave(posts_level);
  for (int k = std::max(shown, craters_.smallest_octave()); k <= std::min(craters_.largest_octave(), of_posts - 1); ++k)
    add_craters(grid, k, heights_m);
  for (int k = std::max(shown, relief_.shortest_octave()); k <= std::min(relief_.longest_octave(), of_posts - 1); ++k)
    for (std::size_t r = 0; r < grid.rows(); ++r)
      for (std::size_t c = 0; c < grid.columns(); ++c)
        heights_m[r * grid.columns() + c] += relief_.height_m(
            k, {grid.cos_lat[r] * grid.cos_lon[c], grid.cos_lat[r] * grid.sin_lon[c], grid.sin_lat[r]});
}

}  // namespace selenograph::dem
