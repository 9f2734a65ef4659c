// An object's triangles, ready for rays: satellites, landers, boulders that a DEM doesn't hold.
#pragma once

#include "engine/visibility/object_shape.h"
#include "engine/visibility/raytrace/object_tracer.h"

namespace selenograph::engine {

// Immutable, shared between the frames that it is in.
class ObjectMesh {
 public:
  explicit ObjectMesh(ObjectShape shape);
  // Throws as read_object_shape does.
  static ObjectMesh read(const std::string& path) { return ObjectMesh(read_object_shape(path)); }

  const ObjectShape& shape() const { return shape_; }
  const ObjectTracer& tracer() const { return tracer_; }
  // A ball around all corners, in the file's coordinates and units.
  const Vec3& centre() const { return centre_; }
  double radius() const { return radius_; }
  // Of everything that a frame can depend on.
  std::uint64_t fingerprint() const { return fingerprint_; }

 private:
  ObjectShape shape_;
  Vec3 centre_;
  double radius_ = 0;
  ObjectTracer tracer_;
  std::uint64_t fingerprint_;
};

}  // namespace selenograph::engine
