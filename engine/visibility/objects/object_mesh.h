// An object's triangles with their ray-tracing structure: satellites, landers, boulders that are not in a DEM.
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "dem/base/stop_token.h"
#include "engine/scene/object_shape.h"
#include "engine/visibility/embree/object_tracer.h"

namespace selenograph::engine {

// Immutable; shared between frames.
class ObjectMesh {
 public:
  // Drops triangles that reach farther than kStray times the median distance of the corners from their median position:
  // such a file is damaged, and float could not resolve the rest of the object. Builds the ray-tracing structure, which
  // takes a second for every few million triangles. Throws Cancelled when `stop` says so.
  explicit ObjectMesh(ObjectShape shape, const StopToken& stop = {});
  // Returns the memory of a shape with its ray-tracing structure.
  static std::size_t bytes_for(const ObjectShape& shape) { return shape.bytes() + ObjectTracer::bytes_for(shape); }

  const ObjectShape& shape() const { return shape_; }
  const ObjectTracer& tracer() const { return tracer_; }
  static constexpr double kStray = 1e4;

  // Warnings about the file: dropped triangles, coordinates rounded by float, textures. Usually empty.
  const std::vector<std::string>& notes() const { return notes_; }
  // Bounding sphere of all corners, in the coordinates and units of the file.
  const Vec3& centre() const { return bounds_.centre; }
  double radius() const { return bounds_.radius; }
  // Origin of the coordinates of the tracer: the centre of the bounding sphere or, if a few corners are far from the
  // others, the median position.
  const Vec3& middle() const { return bounds_.middle; }
  // Returns the rounding error of a point on the mesh, a length in the units of the file: the facet that a shadow ray
  // leaves, and its neighbours in the same plane, are nearer than this along the normal.
  double rounding_at(const Vec3& point) const;
  std::size_t bytes() const { return sizeof(ObjectMesh) + bytes_for(shape_); }
  // Hash of all members that a frame can depend on.
  std::uint64_t fingerprint() const { return fingerprint_; }

 private:
  // The median position of the corners in use, and the median distance from it.
  struct Median {
    Vec3 position = Vec3::zero();
    double distance = 0;
    double core() const { return 16 * distance; }  // radius that contains a well-formed object
  };
  static Median median_of(const ObjectShape& shape);
  static ObjectShape without_strays(ObjectShape shape, Median& median, std::vector<std::string>& notes);

  // Declared before the shape, whose initialiser fills it.
  std::vector<std::string> notes_;
  Median median_;
  ObjectShape shape_;
  struct Bounds {
    Vec3 centre, middle;
    double radius;
  };
  Bounds bounds_of() const;
  Bounds bounds_;
  ObjectTracer tracer_;
  std::uint64_t fingerprint_;
};

}  // namespace selenograph::engine
