// The Sun's disc by shadow maps: how much of it each point sees.
//
// The visible share is a mean over kDiscSamples directions, the same ones that rays use. Nine of them are cast for
// every point: the middle of the disc and its rim. Where all nine are free the disc counts as visible, where none is as
// hidden; where they disagree, and a few pixels around, the other directions are cast, too.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "engine/visibility/raytrace/trace.h"
#include "engine/visibility/zbuffer/shadow_map.h"

namespace selenograph::engine {

struct DiscScratch {
  std::vector<LightSamples> turned, doubtful;
  std::vector<std::uint8_t> dark;                       // per pixel: how many directions are blocked
  std::vector<std::uint8_t> doubt, along_rows, around;  // per pixel; the latter two: within a margin of doubt
  std::size_t bytes() const;
};

class SunDisc {
 public:
  // `sun`: unit, toward the disc's middle.
  explicit SunDisc(const Sun& sun);
  const std::array<Vec3, kDiscSamples>& directions() const { return directions_; }

  // Per lane the directions that its facet faces, a bit each.
  void faced_by(const SurfacePoints& points, std::int32_t faces[kPacket]) const;

  // Sets scratch.dark of the samples' pixels; width x height pixels. `middle`: the map that the samples were placed in.
  // Parallel; stops between bands.
  void cast(const RasterMesh& mesh, const ShadowMap& middle, int width, int height,
            const std::vector<LightSamples>& samples, LightScratch& light, DiscScratch& scratch,
            const StopToken& stop) const;

  // Of the disc, at a point that faces some directions, `dark` of which are blocked.
  static float lit_share(std::uint32_t faces, std::uint8_t dark);

 private:
  std::array<Vec3, kDiscSamples> directions_;
};

}  // namespace selenograph::engine
