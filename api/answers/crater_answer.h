// A crater in the metadata of a frame.
#pragma once

#include "api/schema/answers.h"
#include "engine/frame/rims.h"

namespace selenograph::api {

// Table of a crater's members: those of POST /v1/features, and its outline in the image.
const Answer<engine::CraterRim>& crater_answer();

// Returns x rounded to 0.001, so that a position in pixels takes few digits.
double thousandths(double x);

}  // namespace selenograph::api
