// Trigonometry in degrees, exact at multiples of 90 degrees.
//
// The formulas are those of GeographicLib 2.1, copied because answers' bytes hang on them: over 10^7 random angles
// versions 2.1 (Debian 12) and 2.5 (Debian 13) give these bits, but at multiples of 30 and 45 degrees 2.5 gives others.
// Tests compare coordinates with the library's.
#pragma once

#include <cmath>
#include <numbers>
#include <utility>

namespace selenograph {

struct SineCosine {
  double sine, cosine;
};

// Returns the sine and cosine of an angle.
inline SineCosine sine_cosine_of_deg(double angle_deg) {
  // Reduce to at most 45 degrees, without rounding.
  int quarters = 0;
  const double rest = std::remquo(angle_deg, 90.0, &quarters) * (std::numbers::pi / 180);
  const double s = std::sin(rest), c = std::cos(rest);
  SineCosine out{};
  switch (static_cast<unsigned>(quarters) % 4) {
    case 0:
      out = {s, c};
      break;
    case 1:
      out = {c, -s};
      break;
    case 2:
      out = {-s, -c};
      break;
    default:
      out = {-c, s};
  }
  out.cosine += 0.0;  // no negative zero
  if (out.sine == 0) out.sine = std::copysign(0.0, angle_deg);
  return out;
}

// Returns the polar angle of a point, in [-180, 180] degrees.
inline double atan2_deg(double y, double x) {
  // Take the arc tangent of a ratio of at most 1, from the nearest axis.
  enum { east, west, north, south } side = x < 0 ? west : east;
  if (std::abs(y) > std::abs(x)) {
    side = y < 0 ? south : north;
    std::swap(x, y);
  }
  const double from_axis_deg = std::atan2(y, std::abs(x)) / (std::numbers::pi / 180);
  switch (side) {
    case east:
      return from_axis_deg;
    case west:
      return std::copysign(180, y) - from_axis_deg;
    case north:
      return 90 - from_axis_deg;
    case south:
      return from_axis_deg - 90;
  }
  return from_axis_deg;
}

}  // namespace selenograph
