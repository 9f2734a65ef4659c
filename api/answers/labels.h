// Labels of a frame: masks of its craters and rocks, on which detectors are trained, and the numbers in them.
#pragma once

#include <cstdint>
#include <vector>

#include "api/schema/answers.h"
#include "engine/frame/camera.h"
#include "engine/frame/frame.h"

namespace selenograph::api {

struct LabelledRock {
  const dem::RockFeature& feature;
  std::uint16_t mask_id;  // its number in the mask
};

// Numbers count from 1, craters first, then rocks, each the largest first; 0 is a pixel or a crater without a label.
struct FrameLabels {
  // height x width pixels. A crater has the pixels whose centres are within its rim, hidden or not; where craters
  // overlap, the smallest one wins. A rock has the pixels that see it.
  std::vector<std::uint16_t> crater_mask, rock_mask;
  std::vector<std::uint16_t> crater_ids;  // numbers of the report's craters; 0: nothing of its rim is in the image
  std::vector<LabelledRock> rocks;
};

// `frame` must have craters and the product kRock, and outlive the labels. Rocks are labelled if they cover at least as
// many pixels as a circle of diameter `min_diameter_px`. Throws RequestError if there are more numbers than a pixel can
// hold.
FrameLabels label_frame(const engine::Frame& frame, const engine::Camera& camera, double min_diameter_px);

// Table of a labelled rock's members: those of POST /v1/features, and its number.
const Answer<LabelledRock>& rock_answer();

}  // namespace selenograph::api
