#include "engine/scene/raster_mesh.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <unordered_map>

#include "dem/base/hash.h"
#include "dem/base/parallel.h"
#include "engine/scene/vertex_rows.h"

namespace selenograph::engine {
namespace {

constexpr int kStripRows = 16;
constexpr int kLanes = 16;  // the widest vector
constexpr int kMaxQuads = 64;

// Radius at which skirts end, below all relief.
constexpr double kFoot_m = kMoonRadius_m + 2 * dem::kLowestRelief_m;

RowAngles angles_of(const dem::Block& posts, int row) {
  const auto r = static_cast<std::size_t>(row);
  return {posts.cos_lat[r], posts.sin_lat[r], posts.cos_lon.data(), posts.sin_lon.data()};
}

// Returns the box of a strip in axes east, north and up of its middle, and its steepest rises; without vertices, one
// without rows.
RasterShape::Box box_of(const MeshBlock& block, int first_row, int rows) {
  const dem::Block& posts = *block.posts;
  const int side = block.side, last = side - 1;
  const Vec3 middle = posts.position(first_row + rows / 2, last / 2, 0);
  const EastNorthUp axes = local_axes(middle);
  LocalBounds bounds;
  LocalRow row_pair[2]{};  // in turns: the row of one step is the southern one of the next
  for (int r = first_row; r <= first_row + rows; ++r) {
    LocalRow &row = row_pair[r & 1], &south = row_pair[~r & 1];
    local_row(&block.vertices[posts.index(r, 0)], side, angles_of(posts, r), middle, axes, row);
    const auto place_vertex = [&](int c) {
      const Vec3 from_middle = block.vertex(r, c) - middle;
      row.set(c, {axes.east.dot(from_middle), axes.north.dot(from_middle), axes.up.dot(from_middle)});
    };
    if (block.collapses) {
      place_vertex(0);
      place_vertex(last);
    }
    for (int c = 1; block.collapses && (r == 0 || r == last) && c < last; ++c) place_vertex(c);
    bounds.extend(row, side);
    if (r > first_row) bounds.extend(south, row, last);
  }
  if (bounds.empty()) return {};
  const Vec3 low = Vec3f(bounds.low).cast<double>(), high = Vec3f(bounds.high).cast<double>();
  const Vec3 box_middle = (low + high) / 2, half_extents = (high - low) / 2;
  RasterShape::Box box{first_row,
                       rows,
                       middle + box_middle.x() * axes.east + box_middle.y() * axes.north + box_middle.z() * axes.up,
                       axes,
                       half_extents,
                       {}};
  std::copy_n(bounds.steepest, box.steepest.size(), box.steepest.begin());
  return box;
}

// Returns a strip relative to the anchor. Its box is slightly enlarged to contain the rounded vertices.
Strip strip_of(const RasterShape::Box& box, const Vec3& anchor) {
  Strip s{};
  s.first_row = box.first_row;
  s.rows = box.rows;
  const Vec3 centre = box.centre - anchor;
  const Vec3 half = box.half_m + Vec3::constant(1e-6 * (centre.norm() + 2 * box.half_m.norm()));
  const Vec3 edges[3] = {box.axes.east * half.x(), box.axes.north * half.y(), box.axes.up * half.z()};
  for (int e = 0; e < 3; ++e)
    for (int k = 0; k < 3; ++k) s.half[e][k] = static_cast<float>(edges[e][k]);
  for (int k = 0; k < 3; ++k) s.centre[k] = static_cast<float>(centre[k]);
  std::copy(box.steepest.begin(), box.steepest.end(), s.steepest);
  return s;
}

// Ends of an edge in steps of 1/65536 m: far below the distance of distinct vertices, and above the differences between
// the posts of a pole.
using Ends = std::array<std::int64_t, 6>;
constexpr double kEndsPerMetre = 65536;

std::int64_t steps(double metres) { return static_cast<std::int64_t>(std::floor(metres * kEndsPerMetre + 0.5)); }

Ends ends_of(const Vec3& from, const Vec3& to) {
  Ends ends{};
  for (std::size_t k = 0; k < 3; ++k) {
    const auto i = static_cast<int>(k);
    ends[k] = steps(from[i]);
    ends[3 + k] = steps(to[i]);
  }
  return ends;
}

struct EndsHash {
  std::size_t operator()(const Ends& e) const { return dem::hash_of(e.data(), sizeof e); }
};

// Finds the edges along a block's sides and beside its voids, each with its triangle on the left.
class EdgeFinder {
 public:
  explicit EdgeFinder(RasterShape& shape) : shape_(shape), block_(*shape.mesh_block), quads_(block_.side - 1) {}

  // Finds the edges of all triangles whose neighbour across the edge is missing; without voids, these are the sides.
  void find() {
    const std::span<const dem::Vertex> vertices = block_.vertices;
    const int last = quads_ - 1;
    if (std::none_of(vertices.begin(), vertices.end(), [](const dem::Vertex& v) { return std::isnan(v.height_m); })) {
      for (int i = 0; i <= last; ++i) {
        border(0, 0, i, 0, i + 1);
        border(2, i + 1, 0, i, 0);
        border(1, quads_, i + 1, quads_, i);
        border(3, i, quads_, i + 1, quads_);
      }
      return;
    }
    for (int r = 0; r < quads_; ++r)
      for (int c = 0; c < quads_; ++c) {
        const bool lower = triangle(r, c, false), upper = triangle(r, c, true);
        if (lower && r == 0) border(0, r, c, r, c + 1);
        if (lower && r > 0 && !triangle(r - 1, c, true)) inside(r, c, r, c + 1);
        if (lower && c == 0) border(2, r + 1, c, r, c);
        if (lower && c > 0 && !triangle(r, c - 1, true)) inside(r + 1, c, r, c);
        if (lower && !upper) inside(r, c + 1, r + 1, c);
        if (upper && r == last) border(1, r + 1, c + 1, r + 1, c);
        if (upper && r < last && !triangle(r + 1, c, false)) inside(r + 1, c + 1, r + 1, c);
        if (upper && c == last) border(3, r, c + 1, r + 1, c + 1);
        if (upper && c < last && !triangle(r, c + 1, false)) inside(r, c + 1, r + 1, c + 1);
        if (upper && !lower) inside(r + 1, c, r, c + 1);
      }
  }

 private:
  // Returns true if all vertices of a triangle have data.
  bool triangle(int r, int c, bool upper) const {
    const dem::QuadVertices q = dem::vertices_of(r, c, upper);
    return block_.present(q.r[0], q.c[0]) && block_.present(q.r[1], q.c[1]) && block_.present(q.r[2], q.c[2]);
  }

  std::uint16_t index(int r, int c) const { return static_cast<std::uint16_t>(r * shape_.stride + c); }

  // Adds an edge. Returns false if it has no length.
  bool add(std::vector<RasterShape::Edge>& list, int r0, int c0, int r1, int c1, Ends& ends) const {
    ends = ends_of(block_.vertex(r0, c0), block_.vertex(r1, c1));
    if (std::equal(ends.begin(), ends.begin() + 3, ends.begin() + 3)) return false;
    list.push_back({index(r0, c0), index(r1, c1)});
    return true;
  }

  void inside(int r0, int c0, int r1, int c1) {
    Ends ends;
    add(shape_.inside, r0, c0, r1, c1, ends);
  }

  // Adds an edge to a half side and to its hash. The hash is a sum over edges and symmetric in their ends, so neither
  // order nor direction changes it.
  void border(std::size_t side, int r0, int c0, int r1, int c1) {
    const int quad = side < 2 ? std::min(c0, c1) : std::min(r0, r1);
    RasterShape::Half& half = shape_.along[side][2 * quad < quads_ ? 0 : 1];
    Ends ends;
    if (add(half.edges, r0, c0, r1, c1, ends))
      half.edge_hash +=
          (dem::hash_of(&ends[0], 24) * 0x9e3779b97f4a7c15) ^ (dem::hash_of(&ends[3], 24) * 0x9e3779b97f4a7c15);
  }

  RasterShape& shape_;
  const MeshBlock& block_;
  const int quads_;
};

}  // namespace

RasterShape::RasterShape(std::shared_ptr<const MeshBlock> block) : mesh_block(std::move(block)) {
  const int quads = mesh_block->posts->extent.quads;
  stride = (quads + kLanes - 1) / kLanes * kLanes + kLanes;
  static_assert((kMaxQuads + 1) * (kMaxQuads + 2 * kLanes) <= 1 << 16, "what an edge's ends hold");
  for (int r = 0; r < quads; r += kStripRows)
    if (const Box box = box_of(*mesh_block, r, std::min(kStripRows, quads - r)); box.rows > 0) boxes.push_back(box);
  EdgeFinder(*this).find();
}

RasterPiece::RasterPiece(std::shared_ptr<const RasterShape> shape_of_block, const Vec3& anchor)
    : shape(std::move(shape_of_block)) {
  const MeshBlock& mesh_block = *shape->mesh_block;
  const dem::Block& posts = *mesh_block.posts;
  const auto stride = static_cast<std::size_t>(shape->stride),
             plane = stride * static_cast<std::size_t>(mesh_block.side);
  xyz.resize(3 * plane);
  const auto set_vertex = [&](std::size_t index, int r, int c) {
    const Vec3 vertex = mesh_block.vertex(r, c) - anchor;
    for (std::size_t k = 0; k < 3; ++k) xyz[k * plane + index] = static_cast<float>(vertex[static_cast<int>(k)]);
  };
  for (int r = 0; r < mesh_block.side; ++r) {
    const std::size_t first = static_cast<std::size_t>(r) * stride;
    float* x = &xyz[first];
    place_row(&mesh_block.vertices[posts.index(r, 0)], mesh_block.side, angles_of(posts, r), anchor, x, x + plane,
              x + 2 * plane);
    for (float* row_start : {x, x + plane, x + 2 * plane})
      std::fill(row_start + mesh_block.side, row_start + stride, std::numeric_limits<float>::quiet_NaN());
  }
  if (mesh_block.collapses)
    for (int i = 0, last = mesh_block.side - 1; i <= last; ++i)
      for (const auto& [r, c] : {std::pair{0, i}, {last, i}, {i, 0}, {i, last}})
        set_vertex(static_cast<std::size_t>(r) * stride + static_cast<std::size_t>(c), r, c);
  block = {xyz.data(),          xyz.data() + plane, xyz.data() + 2 * plane,
           mesh_block.side - 1, shape->stride,      mesh_block.vertices.data()};
  for (const RasterShape::Box& box : shape->boxes) strips.push_back(strip_of(box, anchor));
}

RasterMesh::RasterMesh(const Mesh& mesh, const Vec3& anchor_m, const RasterParts& before, const StopToken& stop)
    : anchor_(anchor_m) {
  std::unordered_map<const MeshBlock*, std::size_t> shape_of_block;
  for (std::size_t i = 0; i < before.shapes.size(); ++i) shape_of_block.emplace(before.shapes[i]->mesh_block.get(), i);
  pieces_.resize(mesh.blocks().size());
  in_parallel(pieces_.size(), [&](std::size_t i) {
    stop.check();
    const auto found = shape_of_block.find(&mesh.blocks()[i]);
    if (found == shape_of_block.end())
      pieces_[i] = std::make_shared<RasterPiece>(std::make_shared<RasterShape>(mesh.share(i)), anchor_);
    else if (before.pieces.empty())
      pieces_[i] = std::make_shared<RasterPiece>(before.shapes[found->second], anchor_);
    else
      pieces_[i] = before.pieces[found->second];
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

// Adds skirts below edges that only one triangle has. Inside a block these lie beside voids. On its border they are
// edges without an equal edge in another block. Most sides equal a neighbour's whole side, or half the side of a
// coarser neighbour, which hashes tell; only the rest is compared edge by edge.
//
//   coarse block   +---- half 0 ----+---- half 1 ----+   hash of the side: sum of its halves
//   fine blocks    +-- whole side --+-- whole side --+   hash of a whole side = hash of a half
void RasterMesh::add_skirts() {
  struct Open {
    const RasterShape* shape;
    const std::vector<RasterShape::Edge>* edges;
  };
  std::vector<Open> open_lists;  // edges that hashes have not matched
  using Count = std::unordered_map<std::uint64_t, int>;
  const auto count_of = [](std::uint64_t hash, const Count& count) {
    const auto found = count.find(hash);
    return found == count.end() ? 0 : found->second;
  };
  const auto for_each_side = [&](const auto& visit) {
    for (const auto& piece : pieces_)
      for (const auto& side : piece->shape->along)
        if (const std::uint64_t hash = side[0].edge_hash + side[1].edge_hash; hash != 0)
          visit(*piece->shape, side, hash);
  };
  using Side = std::array<RasterShape::Half, 2>;
  const auto has_halves = [](const Side& side) { return side[0].edge_hash != 0 && side[1].edge_hash != 0; };
  Count wholes, halves;  // numbers of whole and of half sides, by hash
  wholes.reserve(4 * pieces_.size());
  for_each_side([&](const RasterShape&, const Side&, std::uint64_t hash) { ++wholes[hash]; });
  // Skip sides with an empty half: their hash equals that of the other half, and they would match themselves.
  for_each_side([&](const RasterShape&, const Side& side, std::uint64_t hash) {
    if (wholes[hash] == 1 && has_halves(side))
      for (const RasterShape::Half& half : side) ++halves[half.edge_hash];
  });
  // Returns whether a whole side of one block equals a half side of another.
  const auto is_joined = [&](std::uint64_t hash) { return count_of(hash, wholes) == 1 && count_of(hash, halves) == 1; };
  for_each_side([&](const RasterShape& shape, const Side& side, std::uint64_t hash) {
    if (wholes[hash] == 2 || is_joined(hash)) return;
    for (const RasterShape::Half& half : side)
      if (!half.edges.empty() && !(has_halves(side) && is_joined(half.edge_hash)))
        open_lists.push_back({&shape, &half.edges});
  });
  for (const auto& piece : pieces_)
    if (!piece->shape->inside.empty()) open_lists.push_back({piece->shape.get(), &piece->shape->inside});
  const auto ends_of_edge = [](const RasterShape& shape, const RasterShape::Edge& edge) {
    return ends_of(shape.vertex(edge.from), shape.vertex(edge.to));
  };
  std::unordered_map<Ends, int, EndsHash> unmatched;  // numbers of directed edges without an opposite one
  for (const auto& [shape, list] : open_lists)
    for (const RasterShape::Edge& edge : *list) {
      const Ends edge_ends = ends_of_edge(*shape, edge),
                 reversed{edge_ends[3], edge_ends[4], edge_ends[5], edge_ends[0], edge_ends[1], edge_ends[2]};
      if (const auto found = unmatched.find(reversed); found != unmatched.end()) {
        if (--found->second == 0) unmatched.erase(found);
      } else {
        ++unmatched[edge_ends];
      }
    }
  for (const auto& [shape, list] : open_lists)
    for (const RasterShape::Edge& edge : *list) {
      const auto found = unmatched.find(ends_of_edge(*shape, edge));
      if (found == unmatched.end()) continue;
      if (--found->second == 0) unmatched.erase(found);  // equal edges get one skirt each
      add_skirt(shape->vertex(edge.from), shape->vertex(edge.to));
    }
}

// Adds the two triangles of a skirt below an edge. The terrain is left of the edge, so the skirt's outside is right of
// it.
void RasterMesh::add_skirt(const Vec3& from, const Vec3& to) {
  const Vec3 a = to - anchor_, b = from - anchor_, c = from * (kFoot_m / from.norm()) - anchor_,
             d = to * (kFoot_m / to.norm()) - anchor_;
  const auto add = [&](const Vec3& p, const Vec3& q, const Vec3& r) {
    Skirt skirt{};
    for (int k = 0; k < 3; ++k) {
      skirt.a[k] = static_cast<float>(p[k]);
      skirt.b[k] = static_cast<float>(q[k]);
      skirt.c[k] = static_cast<float>(r[k]);
    }
    skirts_.push_back(skirt);
  };
  add(a, b, c);
  add(a, c, d);
}

RasterParts RasterMesh::parts_for(const Vec3& anchor_m) const {
  RasterParts parts;
  for (const auto& piece : pieces_) parts.shapes.push_back(piece->shape);
  if (anchor_m == anchor_) parts.pieces = pieces_;
  return parts;
}

std::size_t RasterShape::bytes() const {
  std::size_t sum = sizeof(RasterShape) + boxes.size() * sizeof(Box) + inside.size() * sizeof(Edge);
  for (const auto& side : along)
    for (const Half& half : side) sum += half.edges.size() * sizeof(Edge);
  return sum;
}

std::size_t RasterPiece::bytes() const {
  return sizeof(RasterPiece) + xyz.size() * sizeof(float) + strips.size() * sizeof(Strip);
}

std::size_t RasterMesh::own_bytes() const {
  return sizeof(RasterMesh) + blocks_.size() * (sizeof(RasterBlock) + sizeof pieces_[0]) +
         strips_.size() * sizeof(Strip) + skirts_.size() * sizeof(Skirt);
}

std::size_t RasterMesh::bytes() const {
  std::size_t sum = own_bytes();
  for (const auto& piece : pieces_) sum += piece->bytes() + piece->shape->bytes();
  return sum;
}

}  // namespace selenograph::engine
