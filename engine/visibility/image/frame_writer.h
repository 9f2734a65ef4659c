// Writes the products of pixels and counts what they see.
#pragma once

#include <cstdint>
#include <mutex>
#include <optional>

#include "dem/base/stop_token.h"
#include "engine/camera/packet_rays.h"
#include "engine/camera/row_views.h"
#include "engine/frame/products.h"
#include "engine/frame/request.h"
#include "engine/indirect/terrain_light.h"
#include "engine/scene/mesh.h"
#include "engine/support/packet.h"
#include "engine/visibility/image/frame_sources.h"
#include "engine/visibility/image/view_marks.h"
#include "engine/visibility/objects/objects_in_frame.h"

namespace selenograph::engine {

// Numbers of pixels by what they see.
struct PixelCounts {
  std::uint64_t hit = 0;      // terrain or an object
  std::uint64_t missing = 0;  // no hit, although the ray meets the Moon: terrain without data
  std::uint64_t filled = 0;   // terrain with filled posts
  std::uint64_t blended = 0;  // terrain where layers are blended
  std::uint64_t on_object = 0;
  std::uint64_t on_rock = 0;
};

// Allocates the requested products, filled with the value for no hit. `pixels`: size of radiance, which covers the
// whole image; `n`: size of the other products.
void allocate_products(FrameProducts& out, ProductSet requested, std::size_t pixels, std::size_t n,
                       const StopToken& stop);

class FrameWriter {
 public:
  // Allocates and initialises the requested products, which takes time. `request`, `views` and `mesh` must outlive this
  // object.
  FrameWriter(const FrameRequest& request, const RowViews& views, const Mesh& mesh, std::size_t catalogue_size,
              FrameProducts& out, const StopToken& stop);

  FrameProducts& out() const { return out_; }
  bool wants_geometry() const { return wants_geometry_; }
  // Returns whether ground-truth products are requested for a row of pixels.
  bool wants_geometry_of(int y) const { return wants_geometry_ && (!request_.truth || request_.truth->has_row(y)); }
  // Returns the index of a pixel in the ground-truth products; empty: not requested.
  std::optional<std::size_t> slot(std::size_t pixel) const {
    if (!request_.truth) return pixel;
    const auto width = static_cast<std::size_t>(request_.camera.width);
    return request_.truth->slot(static_cast<int>(pixel % width), static_cast<int>(pixel / width));
  }

  // Counts all hit lanes and their sources at once and returns true; or counts none and returns false, if a lane is on
  // a quad with several sources.
  bool account_all(const TriangleId triangles[kPacket], std::uint32_t hits, PixelCounts& counts);
  // Counts one lane and its source.
  void account(const SurfacePoints& points, int lane, std::size_t pixel, PixelCounts& counts);
  void store_geometry(const SurfacePoints& points, int lane, const Vec3& direction, const Shading& shading, float lit,
                      std::size_t pixel) const;
  // Returns whether an object index is a rock: rocks are numbered after the objects of the request.
  bool is_rock(std::uint16_t object) const { return object != kNoObject && object >= request_.objects.size(); }
  void count_object(const ObjectLanes& lanes, int lane, PixelCounts& counts) const {
    ++counts.hit;
    if (!lanes.on_soil[lane]) ++(is_rock(lanes.object[lane]) ? counts.on_rock : counts.on_object);
  }
  bool wants_albedo() const { return !out_.albedo.empty(); }
  void store_albedo(double albedo, std::size_t pixel) const;
  void store_flow(double right_px, double down_px, std::size_t pixel) const;
  void store_object(const ObjectLanes& lanes, int lane, const Vec3& direction, float lit, std::size_t pixel) const;

  // Light of the product `irradiance`; by default none.
  struct Light {
    double direct_w_m2 = 0;
    const TerrainLight* indirect = nullptr;
  };
  void set_light(const Light& light) { light_ = light; }

  // Sets the marks: pixels whose hits are recorded.
  void set_marks(const ViewMarks& marks) { marks_ = marks; }
  const ViewMarks& marks() const { return marks_; }
  // Returns whether these rows contain marks. If so, mark() must be called for each of their pixels that sees terrain,
  // in the counted sample.
  bool marked(int first_row, int rows) const { return marks_.in_rows(first_row, rows); }
  // Records the hit of a pixel if it has a mark.
  void mark(int x, int y, const SurfacePoints& points, int lane);

  // Adds the counts of a task. Thread-safe.
  void merge(const PixelCounts& counts);

  const PixelCounts& counts() const { return total_; }
  const FrameSources& sources() const { return sources_; }

 private:
  // Stores the products of a lane on terrain or on an object. `spacing_m`: NaN on an object. `slot_index`: as slot()
  // returns it for `pixel`.
  void store_point(const SurfacePoints& points, int lane, const Vec3& direction, const Shading& shading, float lit,
                   float spacing_m, std::size_t pixel, std::size_t slot_index) const;

  void store_irradiance(const Irradiance& indirect, double incident, float lit, std::size_t slot_index) const;

  const FrameRequest& request_;
  const RowViews& views_;
  const Mesh& mesh_;
  FrameProducts& out_;
  Light light_;
  bool wants_geometry_;
  FrameSources sources_;
  std::mutex mutex_;
  PixelCounts total_;
  ViewMarks marks_;
};

}  // namespace selenograph::engine
