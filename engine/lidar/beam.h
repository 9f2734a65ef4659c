// A beam as sub-rays: parts of a Gaussian that are Gaussians themselves.
#pragma once

#include <span>
#include <vector>

#include "dem/grid/geodesy.h"

namespace selenograph::engine {

// Offsets are tangents of angles from the beam's axis, in units of the beam's standard deviation along one direction
// (a quarter of the divergence, which is the full angle at 1/e^2). Weights sum to 1.
struct SubRay {
  double x, y, weight;
};

// A centre and hexagonal rings around it. Each sub-ray stands for a Gaussian of deviation `part`: all of them together
// have the beam's variance. Seven are the quadrature of degree 5 of Stroud (Approximate calculation of multiple
// integrals, 1971, E_2^{r^2}: 5-1) for what the parts leave: moments to the fifth are those of the beam.
struct SubRays {
  explicit SubRays(int number);  // 1, 7, 19, 37 or 61; anything else throws std::invalid_argument
  std::vector<SubRay> rays;
  double part;      // of each sub-ray, 0 to 1
  double farthest;  // from the axis, with three deviations of its part
};

// Two unit vectors across a unit direction; the same for all beams of a like direction.
struct Across {
  explicit Across(const Vec3& direction);
  Vec3 x, y;
};

}  // namespace selenograph::engine
