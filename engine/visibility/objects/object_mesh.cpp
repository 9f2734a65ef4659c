#include "engine/visibility/objects/object_mesh.h"

#include <fmt/format.h>

#include <algorithm>

#include "dem/base/hash.h"
#include "dem/base/quantile.h"
#include "engine/support/box.h"

namespace selenograph::engine {
namespace {

std::uint64_t fingerprint_of(const ObjectShape& shape) {
  std::uint64_t hash = 0;
  const auto add = [&](const auto& list) {
    hash = dem::hash_of(list.data(), list.size() * sizeof list[0], hash ^ list.size());
  };
  add(shape.corners);
  add(shape.triangles);
  for (const std::string& part : shape.parts) add(part);
  return hash;
}

// Returns the largest rounding error of the coordinates, which are read as float.
double rounding_of(const ObjectShape& shape) {
  float largest = 0;
  for (const ObjectCorner& corner : shape.corners) largest = std::max(largest, corner.place.max_abs());
  return static_cast<double>(largest) * 0x1p-24;
}

// Rounding error of ray tracing relative to a coordinate: of the 24 bits of float, 20 separate a facet from its
// neighbours.
constexpr double kRounding = 0x1p-20;

}  // namespace

ObjectMesh::Median ObjectMesh::median_of(const ObjectShape& shape) {
  std::vector<double> values(3 * shape.triangles.size());
  const auto median = [&](auto&& value_of) {
    for (std::size_t i = 0; i < values.size(); ++i)
      values[i] = value_of(shape.place(shape.triangles[i / 3], static_cast<int>(i % 3)));
    return ranked(values, values.size() / 2);
  };
  Median m{};
  for (int axis = 0; axis < 3; ++axis) m.position[axis] = median([axis](const Vec3& p) { return p[axis]; });
  m.distance = median([&](const Vec3& p) { return (p - m.position).norm(); });
  return m;
}

// Drops the triangles that reach farther than kStray median distances from the median position, unless all do. Sets
// `median`, and notes what was dropped.
ObjectShape ObjectMesh::without_strays(ObjectShape shape, Median& median, std::vector<std::string>& notes) {
  median = median_of(shape);
  const double max_reach = kStray * median.distance;
  if (median.distance == 0) return shape;
  double farthest = 0;
  // A triangle is stray if any of its corners is.
  const auto is_stray = [&](const ObjectTriangle& t) {
    double reach = 0;
    for (int k = 0; k < 3; ++k) reach = std::max(reach, (shape.place(t, k) - median.position).norm());
    if (reach > max_reach) farthest = std::max(farthest, reach);
    return reach > max_reach;
  };
  const auto stray_count = std::count_if(shape.triangles.begin(), shape.triangles.end(), is_stray);
  if (stray_count == 0 || stray_count == std::ssize(shape.triangles)) return shape;
  std::erase_if(shape.triangles, is_stray);
  notes.push_back(fmt::format(
      "{} triangle{} left out, which reach{} as far as {:.3g} from the middle; half of all corners are within {:.3g}",
      stray_count, stray_count == 1 ? " is" : "s are", stray_count == 1 ? "es" : "", farthest, median.distance));
  // Keep only the corners in use: the tracer would have to represent the stray ones in float, too.
  std::vector<std::uint32_t> new_index(shape.corners.size(), ~0U);
  std::vector<ObjectCorner> used_corners;
  for (ObjectTriangle& t : shape.triangles)
    for (std::uint32_t& corner : t.corner) {
      if (new_index[corner] == ~0U) {
        new_index[corner] = static_cast<std::uint32_t>(used_corners.size());
        used_corners.push_back(shape.corners[corner]);
      }
      corner = new_index[corner];
    }
  shape.corners = std::move(used_corners);
  median = median_of(shape);
  return shape;
}

ObjectMesh::Bounds ObjectMesh::bounds_of() const {
  Box3 box;
  for (const ObjectTriangle& t : shape_.triangles)
    for (int k = 0; k < 3; ++k) box.extend(shape_.place(t, k));
  Bounds bounds{box.centre(), box.centre(), 0};
  for (const ObjectTriangle& t : shape_.triangles)
    for (int k = 0; k < 3; ++k) bounds.radius = std::max(bounds.radius, (shape_.place(t, k) - bounds.centre).norm());
  if (bounds.radius > median_.core()) bounds.middle = median_.position;
  return bounds;
}

ObjectMesh::ObjectMesh(ObjectShape shape, const StopToken& stop)
    : shape_(without_strays(std::move(shape), median_, notes_)),
      bounds_(bounds_of()),
      tracer_(shape_, bounds_.middle, stop),
      fingerprint_(fingerprint_of(shape_)) {
  constexpr double kNoticeable = 1e-4;
  if (const double rounding = rounding_of(shape_); rounding > kNoticeable * bounds_.radius)
    notes_.push_back(
        fmt::format("its coordinates are so far from their origin that float rounds them by {:.2g}; the object's "
                    "radius is {:.3g}",
                    rounding, bounds_.radius));
  if (shape_.textured) notes_.emplace_back("its textures are not used: its parts are of the materials in the request");
}

double ObjectMesh::rounding_at(const Vec3& point) const {
  return kRounding * std::min(bounds_.radius, std::max(median_.core(), (point - bounds_.middle).norm()));
}

}  // namespace selenograph::engine
