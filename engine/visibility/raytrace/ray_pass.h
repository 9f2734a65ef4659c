// Renders frames by ray tracing: visibility and shadows of sixteen pixels at a time by Embree.
#pragma once

#include <algorithm>
#include <optional>
#include <vector>

#include "dem/base/parallel.h"
#include "engine/camera/packet_rays.h"
#include "engine/visibility/image/flow.h"
#include "engine/visibility/image/frame_job.h"
#include "engine/visibility/image/frame_writer.h"
#include "engine/visibility/points/disc_light.h"
#include "engine/visibility/points/shading.h"
#include "engine/visibility/points/trace.h"

namespace selenograph::engine {

class RayPass {
 public:
  RayPass(const FrameJob& job, FrameWriter& writer);

  // State of one task.
  struct Task {
    PixelCounts counts;
    PacketShader::Sampler sampler;
  };

  // One sample of 4 x 4 pixels from (x, y) on, on its way through the stages; each stage uses the results of the
  // earlier ones.
  struct Packet {
    // A constructor, so that the arrays are not zeroed.
    Packet(int x0, int y0, const SubpixelSample& of, Task& by) : x(x0), y(y0), sample(of), task(by) {}

    int x, y;
    const SubpixelSample& sample;
    Task& task;
    Rays rays;
    // Lanes that see terrain, and lanes that see objects, one bit each.
    std::uint32_t on_terrain, on_object;
    SurfacePoints points;
    Shading shading;
    float lit[kPacket], radiance[kPacket];
    ObjectLanes objects;
    float object_lit[kPacket], object_radiance[kPacket];
  };

  // Calls stages(*this, packet) for all packets of all samples. Parallel; checks the stop token every sixteen packets.
  template <typename Stages>
  void for_pixels(const Stages& stages) {
    const std::vector<SubpixelSample> samples = samples_of(job_.request);
    if (!job_.each) return for_samples(samples, stages);
    for (const SubpixelSample& sample : samples) {
      if (sample.weight > 0) sample_radiance_.assign(writer_.out().radiance.size(), 0.F);
      for_samples({sample}, stages);
      if (!(sample.weight > 0)) continue;
      job_.each(sample, sample_radiance_);
      for (std::size_t i = 0; i < sample_radiance_.size(); ++i)
        writer_.out().radiance[i] += sample.weight * sample_radiance_[i];
    }
  }

  template <typename Stages>
  void for_samples(const std::vector<SubpixelSample>& samples, const Stages& stages) {
    const Camera& camera = job_.request.camera;
    const int across = (camera.width + kTile - 1) / kTile;
    const int along = (camera.height + kTile - 1) / kTile;
    in_parallel_pieces(static_cast<std::size_t>(across * along), 1, [&](std::size_t first, std::size_t past_last) {
      Task task{{}, shader_.sampler(job_.stop)};
      unsigned packets = 0;
      for (int tile = static_cast<int>(first); tile < static_cast<int>(past_last); ++tile) {
        const int x0 = tile % across * kTile, y0 = tile / across * kTile;
        for (int y = y0; y < std::min(y0 + kTile, camera.height); y += kPacketSide)
          for (int x = x0; x < std::min(x0 + kTile, camera.width); x += kPacketSide)
            for (const SubpixelSample& sample : samples) {
              if (packets++ % 16 == 0) job_.stop.check();
              Packet packet(x, y, sample, task);
              stages(*this, packet);
            }
      }
      writer_.merge(task.counts);
    });
  }

  // The stages, in order. The first one makes the rays and finds the visible points.
  void find_points(Packet& packet) const {
    aim(packet);
    intersect_rays(packet);
  }
  void aim(Packet& packet) const;
  void intersect_rays(Packet& packet) const;
  void find_light(Packet& packet) const;
  void find_radiance(Packet& packet) const;
  void write_products(Packet& packet) const;

 private:
  static constexpr int kTile = 32;  // pixels; a tile is one task

  void find_objects(Packet& packet) const;
  void write_objects(Packet& packet) const;
  void write_flow(const Packet& packet) const;
  void light(const SurfacePoints& points, const std::uint16_t* own_object, Shading& shading, float* lit) const;
  std::size_t pixel_of(const Packet& packet, int lane) const;
  // Adds weighted radiance to the product, or stores it if the sample has an array of its own.
  void add_radiance(std::size_t at, float weight, float radiance) const {
    if (sample_radiance_.empty())
      writer_.out().radiance[at] += weight * radiance;
    else
      sample_radiance_[at] = radiance;
  }

  const FrameJob& job_;
  const FrameRequest& request_;
  FrameWriter& writer_;
  PacketRays rays_;
  PacketShader shader_;
  std::optional<DiscLight> disc_;
  std::optional<Flow> flow_;
  // radiance of the current sample if `each` needs it; otherwise empty
  mutable std::vector<float> sample_radiance_;
};

}  // namespace selenograph::engine
