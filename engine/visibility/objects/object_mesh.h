// An object's triangles, ready for rays: satellites, landers, boulders that a DEM doesn't hold.
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "dem/support/stop_token.h"
#include "engine/scene/object_shape.h"
#include "engine/visibility/embree/object_tracer.h"

namespace selenograph::engine {

// Immutable, shared between the frames that it is in.
class ObjectMesh {
 public:
  // Triangles that reach farther than kStray times the median distance of the corners from their median place are left
  // out: such a file is damaged, and what is left of float there would be no object. Builds what rays need: a second
  // for every few million triangles. Throws Cancelled when `stop` says so.
  explicit ObjectMesh(ObjectShape shape, const StopToken& stop = {});
  // Of a shape with what rays need of it.
  static std::size_t bytes_for(const ObjectShape& shape) { return shape.bytes() + ObjectTracer::bytes_for(shape); }

  const ObjectShape& shape() const { return shape_; }
  const ObjectTracer& tracer() const { return tracer_; }
  static constexpr double kStray = 1e4;

  // What is odd about the file, in words: triangles left out, coordinates that float rounded, textures. Mostly empty.
  const std::vector<std::string>& notes() const { return notes_; }
  // A ball around all corners, in the file's coordinates and units.
  const Vec3& centre() const { return bounds_.centre; }
  double radius() const { return bounds_.radius; }
  // What the tracer's rays are relative to: the ball's centre, or, where few corners are far away from the others, the
  // middle of those.
  const Vec3& middle() const { return bounds_.middle; }
  // What float leaves open of a place on it, a length in the file's units: nearer than this along the normal lies the
  // facet that a shadow ray leaves, and its neighbours in the same plane.
  double rounding_at(const Vec3& place) const;
  std::size_t bytes() const { return sizeof(ObjectMesh) + bytes_for(shape_); }
  // Of everything that a frame can depend on.
  std::uint64_t fingerprint() const { return fingerprint_; }

 private:
  // The median place of the corners that triangles have, and the median distance from it.
  struct Median {
    Vec3 place = Vec3::Zero();
    double distance = 0;
    double core() const { return 16 * distance; }  // an ordinary object is within that
  };
  static Median median_of(const ObjectShape& shape);
  static ObjectShape without_strays(ObjectShape shape, Median& median, std::vector<std::string>& notes);

  // Before the shape: found and noted where it is made.
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
