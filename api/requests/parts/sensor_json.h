// "sensor": optics, detector, automatic exposure and motion blur.
#pragma once

#include "api/schema/members.h"
#include "engine/frame/request.h"

namespace selenograph::api {

const Members<engine::SensorModel>& sensor_members();

// Reports contradictions between the sensor and the rest of the request `in`, which has a sensor: no efficiency in the
// band, an Airy disc too wide for its kernel, a pixel pitch that is not the camera's, and effects that are not modelled
// for the request's camera or shutter.
void check_sensor(const JsonReader& in, const engine::FrameRequest& request);

}  // namespace selenograph::api
