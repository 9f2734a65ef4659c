// Craters and rocks in a frame as annotations in the COCO data format (https://cocodataset.org/#format-data), on which
// object detectors are trained.
#pragma once

#include <string>

#include "api/requests/frame_json.h"
#include "engine/frame/frame.h"

namespace selenograph::api {

// Annotations of a frame of one camera, in a file called `image`. Coordinates are COCO's: the top-left corner of the
// top-left pixel is (0, 0), its centre (0.5, 0.5). Craters have outlines, clipped at the image's border; rocks have the
// pixels that see them, as uncompressed run lengths. `frame`: with craters and product kRock; rocks are listed if they
// cover at least as many pixels as a circle of diameter `least_px`. Properties without a place in COCO are additional
// members of the annotations, which its readers ignore.
OrderedJson coco_json(const FrameQuery& query, const engine::Frame& frame, double least_px, const std::string& image);

}  // namespace selenograph::api
