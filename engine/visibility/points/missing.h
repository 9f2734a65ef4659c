// Which rays look at ground of which there are no data, and which at the sky.
#pragma once

#include <cstdint>

#include "dem/catalogue/catalogue.h"
#include "engine/support/packet.h"

namespace selenograph::engine {

class MissingData {
 public:
  // Rays begin at the camera or near it: the nearer, the sooner it is known that they lack no data.
  MissingData(const dem::Catalogue& catalogue, const Vec3& camera_m);

  // How many rays with `toward_moon` miss the Moon for want of data: those that enter the sphere below all relief;
  // those that pass below the datum over a place without a file, looked for where they enter the datum (or begin within
  // it), where they are lowest and where they leave it. The others leave over low ground: sky.
  std::uint64_t count(const Rays& rays, const SurfacePoints& points) const;

 private:
  bool leave_nearby(const Rays& rays, const SurfacePoints& points) const;

  const dem::Catalogue& catalogue_;
  Vec3 camera_m_;
  double covered_m_;  // places at most so far from the camera have data
};

}  // namespace selenograph::engine
