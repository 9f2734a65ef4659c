// "sensor": optics, detector, motion.
#pragma once

#include "api/schema/members.h"
#include "engine/frame/request.h"

namespace selenograph::api {

const Members<engine::SensorModel>& sensor_members();

// Reports a sensor that counts nothing in the request's band or whose Airy disc is too wide there, one whose pitch
// isn't the camera's, and what is not modelled for its camera or its shutter. `in`: the request, which has a sensor.
void check_sensor(const JsonReader& in, const engine::FrameRequest& request);

}  // namespace selenograph::api
