#include "engine/visibility/object_mesh.h"

#define XXH_INLINE_ALL
#include <xxhash.h>

#include <Eigen/Geometry>
#include <algorithm>

namespace selenograph::engine {
namespace {

std::uint64_t fingerprint_of(const ObjectShape& shape) {
  std::uint64_t hash = 0;
  const auto add = [&](const auto& list) {
    hash = XXH3_64bits_withSeed(list.data(), list.size() * sizeof list[0], hash ^ list.size());
  };
  add(shape.corners), add(shape.triangles);
  for (const std::string& part : shape.parts) add(part);
  return hash;
}

Vec3 middle_of(const ObjectShape& shape) {
  Eigen::AlignedBox3d box;
  for (const ObjectTriangle& t : shape.triangles)
    for (int k = 0; k < 3; ++k) box.extend(shape.place(t, k));
  return box.center();
}

}  // namespace

ObjectMesh::ObjectMesh(ObjectShape shape, const StopToken& stop)
    : shape_(std::move(shape)),
      centre_(middle_of(shape_)),
      tracer_(shape_, centre_, stop),
      fingerprint_(fingerprint_of(shape_)) {
  for (const ObjectTriangle& t : shape_.triangles)
    for (int k = 0; k < 3; ++k) radius_ = std::max(radius_, (shape_.place(t, k) - centre_).norm());
}

}  // namespace selenograph::engine
