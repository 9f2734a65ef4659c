#include "engine/scene/soft_normals.h"

#include <algorithm>
#include <array>
#include <vector>

namespace selenograph::engine {
namespace {

// Binomial weights, for neighbours at distance 1 and then 2: they remove waves four vertices long, and leave a fifth of
// those eight long and two thirds of those sixteen long.
constexpr std::array kBinomial{6.F / 16, 4.F / 16, 1.F / 16};
constexpr std::array<std::ptrdiff_t, 2> kDistances{1, 2};

// Smooths normals along a line of vertices that are `step` apart in memory. The last vertex is repeated beyond the end.
void smooth_line(const Vec3f* from, Vec3f* to, std::size_t count, std::size_t step) {
  std::vector<Vec3f> line(count), smoothed(count);
  for (std::size_t i = 0; i < count; ++i) line[i] = from[i * step];
  const auto last = static_cast<std::ptrdiff_t>(count) - 1;
  const auto at = [&](std::ptrdiff_t i) -> const Vec3f& {
    return line[static_cast<std::size_t>(std::clamp<std::ptrdiff_t>(i, 0, last))];
  };
  for (const std::ptrdiff_t d : kDistances) {
    for (std::ptrdiff_t i = 0; i <= last; ++i)
      smoothed[static_cast<std::size_t>(i)] = kBinomial[0] * at(i) + kBinomial[1] * (at(i - d) + at(i + d)) +
                                              kBinomial[2] * (at(i - 2 * d) + at(i + 2 * d));
    line.swap(smoothed);
  }
  for (std::size_t i = 0; i < count; ++i) to[i * step] = line[i];
}

}  // namespace

void soften_normals(std::span<dem::Vertex> vertices, int side, Corners shares) {
  const auto n = static_cast<std::size_t>(side), last = n - 1;
  std::vector<Vec3f> own(n * n), along_rows(n * n), smoothed(n * n);
  for (std::size_t i = 0; i < own.size(); ++i) own[i] = vertices[i].normal;
  for (std::size_t r = 0; r < n; ++r) smooth_line(&own[r * n], &along_rows[r * n], n, 1);
  // Smooth edges only along themselves and corners not at all, so that both sides of an edge get the same normals.
  for (std::size_t c = 1; c < last; ++c) {
    smooth_line(&along_rows[c], &smoothed[c], n, n);
    for (const std::size_t r : {std::size_t{0}, last}) smoothed[r * n + c] = along_rows[r * n + c];
  }
  for (const std::size_t c : {std::size_t{0}, last}) {
    smooth_line(&own[c], &smoothed[c], n, n);
    for (const std::size_t r : {std::size_t{0}, last}) smoothed[r * n + c] = own[r * n + c];
  }
  const auto of_corner = [&](int north, int east) {
    return static_cast<float>(share_at(shares, 2 * north + east)) / kSoftBlocks;
  };
  const float per_vertex = 1.F / static_cast<float>(last);
  for (std::size_t r = 0; r < n; ++r) {
    const float up = static_cast<float>(r) * per_vertex, down = static_cast<float>(last - r) * per_vertex;
    const float west = down * of_corner(0, 0) + up * of_corner(1, 0),
                east = down * of_corner(0, 1) + up * of_corner(1, 1);
    for (std::size_t c = 0; c < n; ++c) {
      const float share = (static_cast<float>(last - c) * west + static_cast<float>(c) * east) * per_vertex;
      const std::size_t i = r * n + c;
      if (share > 0) vertices[i].normal = (own[i] + share * (smoothed[i] - own[i])).normalized();
    }
  }
}

}  // namespace selenograph::engine
