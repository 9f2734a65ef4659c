// "sky": stars, Sun, Earth and planets in view besides the Moon.
#pragma once

#include "api/requests/parts/pose_json.h"
#include "api/schema/member_kinds.h"
#include "api/schema/members.h"
#include "engine/frame/sky.h"

namespace selenograph::api {

// Catalogue used for "stars": true.
inline constexpr const char* kBrightStars = "bright";

// "sky" as a client writes it: the velocity may be in any frame, and the epoch is the Sun's unless given.
struct SkyForm : EpochForm {
  engine::SkyOptions options;
  PoseFrame velocity_frame = engine::BodyFrame::moon_me;
  std::optional<Vec3> velocity_m_s;
  std::optional<Named<dem::ValueMap>> earth_map;
};
const Members<SkyForm, engine::SkyOptions>& sky_members();

}  // namespace selenograph::api
