// Plan of a frame: what is drawn, what its sensor counts, and how many moments of the exposure there are.
#pragma once

#include <optional>
#include <vector>

#include "dem/base/stop_token.h"
#include "dem/terrain/terrain.h"
#include "engine/frame/request.h"
#include "engine/scene/selection.h"
#include "engine/sensor/sensor.h"

namespace selenograph::engine {

struct FramePlan {
  // `asked` must outlive this object. Throws as Sensor does.
  FramePlan(const FrameRequest& asked, const StopToken& stop);
  FramePlan(const FramePlan&) = delete;
  FramePlan& operator=(const FramePlan&) = delete;

  // For an exposure time and the selected terrain: how far a point in view moves in the image, and the number of
  // moments of the exposure, as few as the image needs, including the middle.
  double streak_px(double exposure_s, const Selection& selection, const dem::Terrain& terrain,
                   const StopToken& stop) const;
  int moments(double exposure_s, const Selection& selection, const dem::Terrain& terrain, const StopToken& stop) const;
  // Number of scenes like the frame's that are drawn. Unknown, and counted as one moment, when the frame chooses its
  // exposure time.
  std::size_t draws(const Selection& selection, const dem::Terrain& terrain, const StopToken& stop) const;

  int margin_px() const { return sensor ? sensor->margin_px() : 0; }
  bool moving() const { return sensor && !request.sensor->motion.none(); }

  std::optional<Sensor> sensor;  // if it makes an image
  // The request to draw: as asked, with the sensor's margin and, for craters and the sky, the range of every pixel.
  FrameRequest request;
  RadianceTerms radiance;
  bool emits_elsewhere;  // an object emits, or the ground by a temperature map
  // Request for radiance in the band in which the sensor counts photons, if that differs from the request's band.
  std::optional<FrameRequest> counted;
};

// Removes what was drawn for craters and the sky alone.
void thin(FrameProducts& products, const FrameRequest& asked);

}  // namespace selenograph::engine
