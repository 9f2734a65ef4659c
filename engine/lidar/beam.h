// A beam as a sum of sub-rays: the Gaussian beam is split into narrower Gaussians.
//
//      o o        Seven sub-rays: one on the axis and a hexagonal ring. Each o is the centre of a Gaussian of standard
//     o o o       deviation SubRays::deviation; all of them together have the beam's variance.
//      o o
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

// A centre and hexagonal rings around it. Seven centres are the quadrature of degree 5 of Stroud (Approximate
// calculation of multiple integrals, 1971, E_2^{r^2}: 5-1) for the variance that the sub-rays' own leaves: moments up
// to the fifth are those of the beam.
struct SubRays {
  explicit SubRays(int number);  // 1, 7, 19, 37 or 61; anything else throws std::invalid_argument
  std::vector<SubRay> rays;      // the axis first
  double deviation;              // standard deviation of each sub-ray, in units of the beam's, 0 to 1
  double farthest;               // largest distance from the axis to three deviations past a sub-ray's centre
};

// Two unit vectors perpendicular to a unit direction and to each other. They depend on the direction only.
struct TransverseAxes {
  explicit TransverseAxes(const Vec3& direction);
  Vec3 x, y;
};

}  // namespace selenograph::engine
