// An object's triangles, ready for rays: satellites, landers, boulders that a DEM doesn't hold.
#pragma once

#include <cstddef>
#include <cstdint>

#include "dem/stop_token.h"
#include "engine/visibility/object_shape.h"
#include "engine/visibility/raytrace/object_tracer.h"

namespace selenograph::engine {

// Immutable, shared between the frames that it is in.
class ObjectMesh {
 public:
  // Builds what rays need: a second for every few million triangles. Throws Cancelled when `stop` says so.
  explicit ObjectMesh(ObjectShape shape, const StopToken& stop = {});
  // Of a shape with what rays need of it.
  static std::size_t bytes_for(const ObjectShape& shape) { return shape.bytes() + ObjectTracer::bytes_for(shape); }

  const ObjectShape& shape() const { return shape_; }
  const ObjectTracer& tracer() const { return tracer_; }
  // A ball around all corners, in the file's coordinates and units.
  const Vec3& centre() const { return centre_; }
  double radius() const { return radius_; }
  std::size_t bytes() const { return sizeof(ObjectMesh) + bytes_for(shape_); }
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
