// A rectangle of an image's pixels: "region".
#pragma once

#include <cstdint>

#include "api/schema/members.h"
#include "engine/frame/camera.h"
#include "engine/frame/truth.h"

namespace selenograph::api {

// Returns the most rows and columns that an image may have.
std::int64_t largest_side(const Limits& limits);

const Members<engine::ImageRegion>& region_members();

// Reports a region that exceeds the image. `in`: the object with the member "region".
void check_region(const JsonReader& in, const engine::ImageRegion& region, const engine::Camera& camera);

}  // namespace selenograph::api
