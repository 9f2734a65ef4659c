// A crater in the metadata of a frame.
#pragma once

#include "api/schema/answers.h"
#include "engine/frame/rims.h"

namespace selenograph::api {

// The members of POST /v1/features, and where the crater is in the image.
const Answer<engine::CraterRim>& crater_answer();

}  // namespace selenograph::api
