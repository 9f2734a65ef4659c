// What a frame needs, as far as its request says: what is drawn, what its sensor counts, over how many moments.
#pragma once

#include <optional>
#include <vector>

#include "dem/support/stop_token.h"
#include "dem/terrain/terrain.h"
#include "engine/frame/request.h"
#include "engine/scene/selection.h"
#include "engine/sensor/sensor.h"

namespace selenograph::engine {

struct FramePlan {
  // `asked` outlives it. Throws as Sensor does.
  FramePlan(const FrameRequest& asked, const StopToken& stop);
  FramePlan(const FramePlan&) = delete;
  FramePlan& operator=(const FramePlan&) = delete;

  // Of an exposure of so many seconds over the terrain that was selected: how far a point in view moves in the image,
  // and the moments that stand for the exposure: as few as the image needs, of which the middle is one.
  double streak_px(double exposure_s, const Selection& selection, const dem::Terrain& terrain,
                   const StopToken& stop) const;
  int moments(double exposure_s, const Selection& selection, const dem::Terrain& terrain, const StopToken& stop) const;
  // As many times as scenes like the frame's are drawn. Where the frame chooses its exposure, that isn't known yet.
  std::size_t draws(const Selection& selection, const dem::Terrain& terrain, const StopToken& stop) const;

  int margin_px() const { return sensor ? sensor->margin_px() : 0; }
  bool moving() const { return sensor && !request.sensor->motion.none(); }

  std::optional<Sensor> sensor;  // where it makes an image
  FrameRequest request;          // to be drawn: as asked, with the sensor's margin
  RadianceTerms radiance;
  bool emits_elsewhere;  // an object's material does, or the ground by a map of temperatures
  // Radiance in the band that the sensor counts photons in, where that is not the request's.
  std::optional<FrameRequest> counted;
};

}  // namespace selenograph::engine
