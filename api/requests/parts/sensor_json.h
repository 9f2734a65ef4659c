// "sensor": optics, detector, motion.
#pragma once

#include "api/schema/members.h"
#include "engine/frame/sensor_model.h"

namespace selenograph::api {

const Members<engine::SensorModel>& sensor_members();

// Reports a sensor that counts nothing in this band, or an Airy disc that is too wide there. `in`: the request.
void check_band_of_sensor(const JsonReader& in, const engine::SensorModel& sensor, const engine::Band& band);

}  // namespace selenograph::api
