// Sphere on which a map of the Moon was made.
#pragma once

#include <span>
#include <string>

namespace selenograph::dem {

// Returns the radius of the sphere with these semi-axes, m; 1 737 400 m for radii within 0.5 m of it. Throws DataError
// naming `path` and the semi-axes if they differ, or if they are more than 1 km from the Moon's: latitudes differ on an
// ellipsoid, and another body is not the Moon.
double map_sphere_m(std::span<const double> semi_axes_m, const std::string& path);

// Throws DataError for heights above a sphere other than the Moon's: the file does not tell if they refer to that
// sphere. Radii are accepted: they do not depend on the sphere.
void check_vertical_datum(double sphere_m, bool holds_radii, const std::string& path);

}  // namespace selenograph::dem
