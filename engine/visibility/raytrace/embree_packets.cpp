#include "engine/visibility/raytrace/embree_packets.h"

#include <fmt/format.h>

#include <mutex>
#include <stdexcept>
#include <unordered_map>

#include "engine/visibility/zbuffer/raster_kernels.h"

namespace selenograph::engine {
namespace {

// Embree 3.13's bundles lose hits when a direction's component is (next to) zero for some rays and not for others, so a
// bundle must keep clear of zero in every component.
bool bundled(const RayPacket& rays) {
  constexpr float kClear = 0x1p-10F;
  float low[3], high[3];
  range_of(rays.dx, kPacket, low[0], high[0]);
  range_of(rays.dy, kPacket, low[1], high[1]);
  range_of(rays.dz, kPacket, low[2], high[2]);
  const float size = std::max({-low[0], -low[1], -low[2], high[0], high[1], high[2]});
  for (int k = 0; k < 3; ++k)
    if (!(low[k] > kClear * size || high[k] < -kClear * size)) return false;
  return true;
}

}  // namespace

RTCDevice embree_device(int threads) {
  static std::mutex mutex;
  static std::unordered_map<int, RTCDevice> devices;
  std::lock_guard lock(mutex);
  RTCDevice& d = devices[threads];
  if (!d) d = rtcNewDevice(threads > 0 ? fmt::format("threads={}", threads).c_str() : nullptr);
  if (!d)
    throw std::runtime_error(fmt::format("Embree: no device (error {})", static_cast<int>(rtcGetDeviceError(nullptr))));
  return d;
}

void check_embree(RTCDevice device) {
  if (const RTCError error = rtcGetDeviceError(device); error != RTC_ERROR_NONE)
    throw std::runtime_error(fmt::format("Embree: building the scene failed (error {})", static_cast<int>(error)));
}

RTCIntersectContextFlags coherence(const RayPacket& rays) {
  return bundled(rays) ? RTC_INTERSECT_CONTEXT_FLAG_COHERENT : RTC_INTERSECT_CONTEXT_FLAG_INCOHERENT;
}

}  // namespace selenograph::engine
