#include "engine/scene/raster_mesh.h"

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

// Where skirts end: below all relief.
constexpr double kFoot_m = kMoonRadius_m + 2 * dem::kLowestRelief_m;

// A block's vertices relative to the anchor: x, y, z one after the other, `stride` apart from row to row.
struct Vertices {
  int side, stride;
  std::vector<double> xyz;
  std::size_t plane() const { return static_cast<std::size_t>(stride) * static_cast<std::size_t>(side); }
  std::size_t at(int r, int c) const {
    return static_cast<std::size_t>(r) * static_cast<std::size_t>(stride) + static_cast<std::size_t>(c);
  }
};

// What MeshBlock::vertex() says, bit for bit.
Vertices vertices_of(const MeshBlock& block, const Vec3& anchor, int stride) {
  const dem::Block& posts = *block.posts;
  Vertices v{block.side, stride, {}};
  v.xyz.assign(3 * v.plane(), std::numeric_limits<double>::quiet_NaN());
  const double *cos_lon = posts.cos_lon.data(), *sin_lon = posts.sin_lon.data();
  for (int r = 0; r < v.side; ++r) {
    const double cos_lat = posts.cos_lat[static_cast<std::size_t>(r)],
                 sin_lat = posts.sin_lat[static_cast<std::size_t>(r)];
    const MeshVertex* row = &block.vertices[posts.index(r, 0)];
    double *x = &v.xyz[v.at(r, 0)], *y = x + v.plane(), *z = y + v.plane();
    for (int c = 0; c < v.side; ++c) {
      const double radius = kMoonRadius_m + static_cast<double>(row[c].height_m), across = radius * cos_lat;
      x[c] = across * cos_lon[c] - anchor.x(), y[c] = across * sin_lon[c] - anchor.y(),
      z[c] = radius * sin_lat - anchor.z();
    }
  }
  if (!block.collapses) return v;
  const auto put = [&](int r, int c) {
    const Vec3 at = block.vertex(r, c) - anchor;
    for (std::size_t k = 0; k < 3; ++k) v.xyz[k * v.plane() + v.at(r, c)] = at[static_cast<Eigen::Index>(k)];
  };
  const int last = v.side - 1;
  for (int i = 0; i <= last; ++i) put(0, i), put(last, i), put(i, 0), put(i, last);
  return v;
}

Strip strip_of(const MeshBlock& block, const Vertices& vertices, int first_row, int rows, const Vec3& anchor) {
  const dem::Block& posts = *block.posts;
  const int quads = posts.extent.quads;
  const Vec3 middle = posts.position(first_row + rows / 2, quads / 2, 0);
  const EastNorthUp axes = local_axes(middle);
  const Vec3 from_anchor = middle - anchor;
  Vec3 low = Vec3::Constant(std::numeric_limits<double>::infinity()), high = -low;
  for (int r = first_row; r <= first_row + rows; ++r) {
    const double *x = &vertices.xyz[vertices.at(r, 0)], *y = x + vertices.plane(), *z = y + vertices.plane();
    for (int c = 0; c <= quads; ++c) {
      const double dx = x[c] - from_anchor.x(), dy = y[c] - from_anchor.y(), dz = z[c] - from_anchor.z();
      // Comparisons with NaN are false: voids don't count.
      const auto extend = [&](const Vec3& axis, Eigen::Index k) {
        const double p = axis.x() * dx + axis.y() * dy + axis.z() * dz;
        low[k] = p < low[k] ? p : low[k], high[k] = p > high[k] ? p : high[k];
      };
      extend(axes.east, 0), extend(axes.north, 1), extend(axes.up, 2);
    }
  }
  Strip s{};
  s.first_row = first_row, s.rows = low.x() <= high.x() ? rows : 0;
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

using Edge = RasterPiece::Edge;

struct EdgeHash {
  std::size_t operator()(const Edge& e) const { return XXH3_64bits(e.data(), sizeof e); }
};

void find_edges(RasterPiece& piece) {
  const RasterBlock& b = piece.block;
  const auto at = [&](int r, int c) {
    return static_cast<std::size_t>(r) * static_cast<std::size_t>(b.stride) + static_cast<std::size_t>(c);
  };
  const auto present = [&](int r, int c) { return !std::isnan(b.x[at(r, c)]); };
  const auto triangle = [&](int r, int c, bool upper) {
    if (r < 0 || c < 0 || r >= b.quads || c >= b.quads) return false;
    const dem::QuadVertices q = dem::vertices_of(r, c, upper);
    return present(q.r[0], q.c[0]) && present(q.r[1], q.c[1]) && present(q.r[2], q.c[2]);
  };
  bool whole = true;
  for (int r = 0; r <= b.quads && whole; ++r)
    for (int c = 0; c <= b.quads; ++c) whole &= present(r, c);
  const auto add = [&](std::vector<Edge>& list, int r0, int c0, int r1, int c1) {
    const std::size_t p = at(r0, c0), q = at(r1, c1);
    const Edge e{b.x[p], b.y[p], b.z[p], b.x[q], b.y[q], b.z[q]};
    if (!std::equal(e.begin(), e.begin() + 3, e.begin() + 3)) list.push_back(e);
  };
  const int last = b.quads - 1;
  auto& [south, north, west, east] = piece.along;
  for (int r = 0; r < b.quads; ++r)
    for (int c = 0; c < b.quads; ++c) {
      const bool border = r == 0 || c == 0 || r == last || c == last;
      if (whole && !border) continue;
      const bool lower = triangle(r, c, false), upper = triangle(r, c, true);
      if (lower && !triangle(r - 1, c, true)) add(r == 0 ? south : piece.inside, r, c, r, c + 1);
      if (lower && !triangle(r, c - 1, true)) add(c == 0 ? west : piece.inside, r + 1, c, r, c);
      if (lower && !upper) add(piece.inside, r, c + 1, r + 1, c);
      if (upper && !triangle(r + 1, c, false)) add(r == last ? north : piece.inside, r + 1, c + 1, r + 1, c);
      if (upper && !triangle(r, c + 1, false)) add(c == last ? east : piece.inside, r, c + 1, r + 1, c + 1);
      if (upper && !lower) add(piece.inside, r + 1, c, r, c + 1);
    }
  for (std::size_t side = 0; side < 4; ++side) {
    // A sum doesn't care for the order, and the two ends of an edge are added alike: so nor for the direction.
    std::uint64_t mark = 0;
    for (const Edge& e : piece.along[side])
      mark += (XXH3_64bits(&e[0], 12) * 0x9e3779b97f4a7c15) ^ (XXH3_64bits(&e[3], 12) * 0x9e3779b97f4a7c15);
    piece.mark[side] = mark;
  }
}

std::shared_ptr<const RasterPiece> piece_of(std::shared_ptr<const MeshBlock> of, const Vec3& anchor) {
  auto piece = std::make_shared<RasterPiece>();
  piece->of = std::move(of);
  const MeshBlock& block = *piece->of;
  const int quads = block.posts->extent.quads;
  const int stride = (quads + kLanes - 1) / kLanes * kLanes + kLanes;
  const Vertices vertices = vertices_of(block, anchor, stride);
  const std::size_t plane = vertices.plane();
  piece->xyz.assign(vertices.xyz.begin(), vertices.xyz.end());
  const float* xyz = piece->xyz.data();
  piece->block = {xyz, xyz + plane, xyz + 2 * plane, quads, stride, block.vertices.data()};
  for (int r = 0; r < quads; r += kStripRows) {
    const Strip s = strip_of(block, vertices, r, std::min(kStripRows, quads - r), anchor);
    if (s.rows > 0) piece->strips.push_back(s);
  }
  find_edges(*piece);
  return piece;
}

}  // namespace

RasterMesh::RasterMesh(const Mesh& mesh, const Vec3& anchor_m, const RasterMesh* before, const StopToken& stop)
    : anchor_(anchor_m) {
  std::unordered_map<const MeshBlock*, std::shared_ptr<const RasterPiece>> known;
  if (before && before->anchor_ == anchor_m)
    for (const auto& piece : before->pieces_) known.emplace(piece->of.get(), piece);
  pieces_.resize(mesh.blocks().size());
  in_parallel(pieces_.size(), [&](std::size_t i) {
    stop.check();
    const auto found = known.find(&mesh.blocks()[i]);
    pieces_[i] = found != known.end() ? found->second : piece_of(mesh.share(i), anchor_);
  });
  for (std::size_t i = 0; i < pieces_.size(); ++i) {
    blocks_.push_back(pieces_[i]->block);
    for (Strip s : pieces_[i]->strips) {
      s.block = static_cast<std::uint32_t>(i);
      strips_.push_back(s);
    }
  }
  add_skirts();
}

// Under edges of triangles that no other one shares. Inside of a block they are beside voids; on its border they are
// where the edge of no other block is the same, vertex by vertex: most sides have their like in the neighbour as a
// whole, and only what is left is looked at edge by edge.
void RasterMesh::add_skirts() {
  std::unordered_map<std::uint64_t, int> sides;
  for (const auto& piece : pieces_)
    for (std::size_t side = 0; side < 4; ++side)
      if (!piece->along[side].empty()) ++sides[piece->mark[side]];
  std::vector<const std::vector<Edge>*> open;
  for (const auto& piece : pieces_) {
    if (!piece->inside.empty()) open.push_back(&piece->inside);
    for (std::size_t side = 0; side < 4; ++side)
      if (!piece->along[side].empty() && sides[piece->mark[side]] != 2) open.push_back(&piece->along[side]);
  }
  std::unordered_map<Edge, int, EdgeHash> edges;
  for (const auto* list : open)
    for (const Edge& e : *list) {
      const Edge back{e[3], e[4], e[5], e[0], e[1], e[2]};
      if (const auto found = edges.find(back); found != edges.end()) {
        if (--found->second == 0) edges.erase(found);
      } else {
        ++edges[e];
      }
    }
  for (const auto* list : open)
    for (const Edge& e : *list) {
      const auto found = edges.find(e);
      if (found == edges.end()) continue;
      if (--found->second == 0) edges.erase(found);
      Vec3 foot[2];
      for (std::size_t k = 0; k < 2; ++k) {
        const Vec3 top = anchor_ + Vec3(e[3 * k], e[3 * k + 1], e[3 * k + 2]);
        foot[k] = top * (kFoot_m / top.norm()) - anchor_;
      }
      // The triangle lies to the left of its edge, so the outside of the skirt is to the right.
      Skirt one{}, other{};
      for (std::size_t k = 0; k < 3; ++k) {
        const auto i = static_cast<Eigen::Index>(k);
        one.a[k] = e[3 + k], one.b[k] = e[k], one.c[k] = static_cast<float>(foot[0][i]);
        other.a[k] = e[3 + k], other.b[k] = static_cast<float>(foot[0][i]), other.c[k] = static_cast<float>(foot[1][i]);
      }
      skirts_.push_back(one), skirts_.push_back(other);
    }
}

std::size_t RasterPiece::bytes() const {
  std::size_t sum =
      sizeof(RasterPiece) + xyz.size() * sizeof(float) + strips.size() * sizeof(Strip) + inside.size() * sizeof(Edge);
  for (const auto& side : along) sum += side.size() * sizeof(Edge);
  return sum;
}

std::size_t RasterMesh::own_bytes() const {
  return sizeof(RasterMesh) + blocks_.size() * (sizeof(RasterBlock) + sizeof pieces_[0]) +
         strips_.size() * sizeof(Strip) + skirts_.size() * sizeof(Skirt);
}

std::size_t RasterMesh::bytes() const {
  std::size_t sum = own_bytes();
  for (const auto& piece : pieces_) sum += piece->bytes();
  return sum;
}

}  // namespace selenograph::engine
