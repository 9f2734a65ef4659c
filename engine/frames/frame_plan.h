// Plan stage: derives from a request what is drawn.
#pragma once

#include <optional>

#include "dem/base/stop_token.h"
#include "engine/frame/request.h"
#include "engine/sensor/sensor.h"

namespace selenograph::engine {

struct FramePlan {
  // The request to draw: with the sensor's margin and, for craters and the sky, the range of every pixel.
  FrameRequest request;
  int margin_px = 0;             // of the sensor around the image
  bool moving = false;           // the sensor's exposure is a mean over several times
  RadianceTerms radiance;        // terms of SENSOR++ eq. (1) that all pixels share
  bool emits_elsewhere = false;  // an object emits, or the ground by a temperature map
  // Request for radiance in the band in which the sensor counts photons, if that differs from the request's band.
  std::optional<FrameRequest> photon_request;
};

// Returns the sensor that makes the image, if one does. `request` must outlive it. Throws as Sensor does.
std::optional<Sensor> make_sensor(const FrameRequest& request, const StopToken& stop);

// Returns the plan of a frame. `sensor` is told whether one spectrum stands for all light (Sensor::photon_band).
FramePlan plan_frame(const FrameRequest& request, std::optional<Sensor>& sensor);

// Reduces the products of the plan's request to those that the frame's request asks for: removes ranges that only
// craters and the sky needed, and keeps the pixels of a truth grid.
void keep_requested(FrameProducts& products, const FrameRequest& request);

}  // namespace selenograph::engine
