// Lidar instruments and their patterns of beams.
#pragma once

#include "api/schema/member_kinds.h"
#include "engine/lidar/lidar.h"

namespace selenograph::api {

const Members<engine::LidarInstrument>& lidar_instrument_members();
const Members<engine::LidarPattern>& lidar_pattern_members();
const Members<engine::LidarPulse>& lidar_pulse_members();

}  // namespace selenograph::api
