// The beams of a pattern, in the order in which they are fired.
#pragma once

#include <cstddef>

#include "engine/lidar/lidar.h"

namespace selenograph::engine {

class LidarBeams {
 public:
  // Both must outlive this object.
  LidarBeams(const std::vector<LidarPulse>& pulses, const LidarPattern& pattern) : pulses_(pulses), pattern_(pattern) {}
  std::size_t size() const { return pulses_.empty() ? beams_of(pattern_) : pulses_.size(); }
  LidarPulse at(std::size_t i) const;

  // Returns the number of beams, which may be more than memory holds.
  static std::size_t beams_of(const LidarPattern& pattern);

 private:
  const std::vector<LidarPulse>& pulses_;
  const LidarPattern& pattern_;
};

// Returns the time of the pattern's last beam.
double last_time_s(const LidarPattern& pattern);

}  // namespace selenograph::engine
