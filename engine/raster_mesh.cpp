#include "engine/raster_mesh.h"

#include <xxhash.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <unordered_map>

#include "dem/parallel.h"

namespace selenograph::engine {
namespace {

constexpr int kStripRows = 16;
constexpr int kLanes = 16;  // the widest vector

// Where walls end: below all relief.
constexpr double kFoot_m = kMoonRadius_m + 2 * dem::kLowestRelief_m;

Strip strip_of(const MeshBlock& block, std::uint32_t index, int first_row, int rows, const Vec3& anchor) {
  const dem::Block& posts = *block.posts;
  const int quads = posts.extent.quads;
  const Vec3 middle = posts.position(first_row + rows / 2, quads / 2, 0);
  const EastNorthUp axes = local_axes(middle);
  Vec3 low = Vec3::Constant(std::numeric_limits<double>::infinity()), high = -low;
  for (int r = first_row; r <= first_row + rows; ++r)
    for (int c = 0; c <= quads; ++c) {
      const Vec3 d = block.vertex(r, c) - middle;
      if (std::isnan(d.x())) continue;
      const Vec3 p(axes.east.dot(d), axes.north.dot(d), axes.up.dot(d));
      low = low.cwiseMin(p), high = high.cwiseMax(p);
    }
  Strip s{};
  s.block = index, s.first_row = first_row, s.rows = low.x() <= high.x() ? rows : 0;
  // Slightly larger than the vertices as float has them.
  const Vec3 mid = (low + high) / 2;
  const double slack = 1e-6 * ((middle - anchor).norm() + (high - low).norm());
  const Vec3 half = (high - low) / 2 + Vec3::Constant(slack);
  const Vec3 centre = middle + mid.x() * axes.east + mid.y() * axes.north + mid.z() * axes.up - anchor;
  const Vec3 edges[3] = {axes.east * half.x(), axes.north * half.y(), axes.up * half.z()};
  for (int k = 0; k < 3; ++k) {
    s.centre[k] = static_cast<float>(centre[k]);
    for (int e = 0; e < 3; ++e) s.half[e][k] = static_cast<float>(edges[e][k]);
  }
  return s;
}

}  // namespace

RasterMesh::RasterMesh(const Mesh& mesh, const Vec3& anchor_m) : anchor_(anchor_m) {
  const std::size_t count = mesh.blocks().size();
  vertices_.resize(count), blocks_.resize(count);
  std::vector<std::vector<Strip>> strips(count);
  in_parallel(count, [&](std::size_t i) {
    const MeshBlock& block = mesh.blocks()[i];
    const int quads = block.posts->extent.quads, side = quads + 1;
    const int stride = (quads + kLanes - 1) / kLanes * kLanes + kLanes;
    const std::size_t plane = static_cast<std::size_t>(stride) * static_cast<std::size_t>(side);
    vertices_[i].assign(3 * plane, std::numeric_limits<float>::quiet_NaN());
    float* xyz = vertices_[i].data();
    for (int r = 0; r < side; ++r)
      for (int c = 0; c < side; ++c) {
        const Vec3 v = block.vertex(r, c) - anchor_;
        const std::size_t at =
            static_cast<std::size_t>(r) * static_cast<std::size_t>(stride) + static_cast<std::size_t>(c);
        for (std::size_t k = 0; k < 3; ++k) xyz[k * plane + at] = static_cast<float>(v[static_cast<Eigen::Index>(k)]);
      }
    blocks_[i] = {xyz, xyz + plane, xyz + 2 * plane, quads, stride, block.vertices.data()};
    for (int r = 0; r < quads; r += kStripRows) {
      const Strip s = strip_of(block, static_cast<std::uint32_t>(i), r, std::min(kStripRows, quads - r), anchor_);
      if (s.rows > 0) strips[i].push_back(s);
    }
  });
  for (const auto& s : strips) strips_.insert(strips_.end(), s.begin(), s.end());
  add_walls();
}

// Edges of valid triangles that no other one shares. Inside of a block they are beside voids; on its border they are
// where the edge of no other block is the same, vertex by vertex.
void RasterMesh::add_walls() {
  struct Edge {
    std::array<float, 6> from_to;
    bool operator==(const Edge&) const = default;
  };
  struct Hash {
    std::size_t operator()(const Edge& e) const { return XXH3_64bits(e.from_to.data(), sizeof e.from_to); }
  };
  std::vector<std::vector<Edge>> open(blocks_.size());
  in_parallel(blocks_.size(), [&](std::size_t i) {
    const RasterBlock& b = blocks_[i];
    const auto at = [&](int r, int c) {
      return static_cast<std::size_t>(r) * static_cast<std::size_t>(b.stride) + static_cast<std::size_t>(c);
    };
    const auto present = [&](int r, int c) { return !std::isnan(b.x[at(r, c)]); };
    const auto triangle = [&](int r, int c, bool upper) {
      if (r < 0 || c < 0 || r >= b.quads || c >= b.quads) return false;
      const dem::QuadVertices q = dem::vertices_of(r, c, upper);
      return present(q.r[0], q.c[0]) && present(q.r[1], q.c[1]) && present(q.r[2], q.c[2]);
    };
    const auto add = [&](int r0, int c0, int r1, int c1) {
      const std::size_t p = at(r0, c0), q = at(r1, c1);
      const Edge e{{b.x[p], b.y[p], b.z[p], b.x[q], b.y[q], b.z[q]}};
      if (!std::equal(e.from_to.begin(), e.from_to.begin() + 3, e.from_to.begin() + 3)) open[i].push_back(e);
    };
    bool whole = true;
    for (int r = 0; r <= b.quads && whole; ++r)
      for (int c = 0; c <= b.quads; ++c) whole &= present(r, c);
    for (int r = 0; r < b.quads; ++r)
      for (int c = 0; c < b.quads; ++c) {
        const bool border = r == 0 || c == 0 || r == b.quads - 1 || c == b.quads - 1;
        if (whole && !border) continue;
        const bool lower = triangle(r, c, false), upper = triangle(r, c, true);
        if (lower && !triangle(r - 1, c, true)) add(r, c, r, c + 1);
        if (lower && !triangle(r, c - 1, true)) add(r + 1, c, r, c);
        if (lower && !upper) add(r, c + 1, r + 1, c);
        if (upper && !triangle(r + 1, c, false)) add(r + 1, c + 1, r + 1, c);
        if (upper && !triangle(r, c + 1, false)) add(r, c + 1, r + 1, c + 1);
        if (upper && !lower) add(r + 1, c, r, c + 1);
      }
  });
  std::unordered_map<Edge, int, Hash> edges;
  for (const auto& list : open)
    for (const Edge& e : list) {
      const auto& f = e.from_to;
      const Edge back{{f[3], f[4], f[5], f[0], f[1], f[2]}};
      if (const auto found = edges.find(back); found != edges.end()) {
        if (--found->second == 0) edges.erase(found);
      } else {
        ++edges[e];
      }
    }
  for (const auto& list : open)
    for (const Edge& e : list) {
      const auto found = edges.find(e);
      if (found == edges.end()) continue;
      if (--found->second == 0) edges.erase(found);
      const auto& f = e.from_to;
      Vec3 foot[2];
      for (int k = 0; k < 2; ++k) {
        const Vec3 top = anchor_ + Vec3(f[static_cast<std::size_t>(3 * k)], f[static_cast<std::size_t>(3 * k + 1)],
                                        f[static_cast<std::size_t>(3 * k + 2)]);
        foot[k] = top * (kFoot_m / top.norm()) - anchor_;
      }
      // The triangle lies to the left of its edge, so the outside of the wall is to the right.
      Wall one{}, other{};
      for (std::size_t k = 0; k < 3; ++k) {
        const auto i = static_cast<Eigen::Index>(k);
        one.a[k] = f[3 + k], one.b[k] = f[k], one.c[k] = static_cast<float>(foot[0][i]);
        other.a[k] = f[3 + k], other.b[k] = static_cast<float>(foot[0][i]), other.c[k] = static_cast<float>(foot[1][i]);
      }
      walls_.push_back(one), walls_.push_back(other);
    }
}

std::size_t RasterMesh::bytes() const {
  std::size_t sum = sizeof(RasterMesh) + strips_.size() * sizeof(Strip) + walls_.size() * sizeof(Wall);
  for (const auto& floats : vertices_)
    sum += sizeof(std::vector<float>) + sizeof(RasterBlock) + floats.size() * sizeof(float);
  return sum;
}

}  // namespace selenograph::engine
