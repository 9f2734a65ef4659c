// Deviation of the mesh from the posts of a product that was resampled to the lattice.
#pragma once

#include "dem/terrain/terrain.h"

namespace selenograph::dem {

struct ResamplingError {
  int posts = 0;  // compared posts: valid and not covered by a finer layer
  double rms_m = 0, worst_m = 0;
};

// Compares about `posts` posts spread over a file (always the same ones) with the finest surface. Builds the pyramid
// there.
ResamplingError resampling_error(const Terrain& terrain, int source, int posts);

}  // namespace selenograph::dem
