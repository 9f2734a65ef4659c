// What a frame's products need to be known of each pixel: radiance, how much of the Sun its point sees, geometry.
#pragma once

#include "engine/frame/request.h"

namespace selenograph::engine {

inline bool wants_radiance(const FrameRequest& request) { return request.products & (kRadiance | kImage); }
inline bool wants_light(const FrameRequest& request) { return wants_radiance(request) || (request.products & kLit); }
inline bool wants_geometry(const FrameRequest& request) {
  return request.products & ~static_cast<ProductSet>(kRadiance | kImage);
}

}  // namespace selenograph::engine
