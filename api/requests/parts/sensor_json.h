// "sensor": optics, detector, motion.
#pragma once

#include "api/schema/members.h"
#include "engine/frame/sensor_model.h"

namespace selenograph::api {

const Members<engine::SensorModel>& sensor_members();

}  // namespace selenograph::api
