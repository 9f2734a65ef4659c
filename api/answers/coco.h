// Craters and rocks in a frame as annotations in COCO's data format (https://cocodataset.org/#format-data): what object
// detectors are trained with.
#pragma once

#include <string>

#include "api/requests/frame_json.h"
#include "engine/frame/frame.h"
#include "engine/frame/rims.h"

namespace selenograph::api {

// Of a frame of one camera, in a file called `image`. Coordinates are COCO's: the top-left corner of the top-left
// pixel is (0, 0), its centre (0.5, 0.5). Craters have outlines, cut at the image's border; rocks the pixels that see
// them, as uncompressed run lengths. `rocks`: the frame with kRock as its product, of whose rocks those are listed that
// have at least as many pixels as a circle of so large a diameter. What COCO has no place for are further members of
// the annotations, which its readers leave alone.
OrderedJson coco_json(const FrameQuery& query, const engine::CraterRims& rims, const engine::Frame& rocks,
                      double least_px, const std::string& image);

}  // namespace selenograph::api
