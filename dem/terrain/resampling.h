// How far the mesh is from the posts of a product that had to be resampled onto the lattice.
#pragma once

#include "dem/terrain/terrain.h"

namespace selenograph::dem {

struct ResamplingError {
  int posts = 0;  // compared: valid ones on which no finer layer lies
  double rms_m = 0, worst_m = 0;
};

// Compares about `posts` posts spread over a file (always the same ones) with the finest surface. Has the pyramid
// beneath them built.
ResamplingError resampling_error(const Terrain& terrain, int source, int posts);

}  // namespace selenograph::dem
