// A crater in the metadata of a frame.
#pragma once

#include "api/schema/answers.h"
#include "engine/frame/rims.h"

namespace selenograph::api {

// The members of POST /v1/features, and where the crater is in the image.
const Answer<engine::CraterRim>& crater_answer();

// Rounded to 0.001: a place in pixels takes few digits.
double thousandths(double x);

}  // namespace selenograph::api
