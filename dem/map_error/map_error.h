// Errors of a map that a lander carries: how it differs from the terrain that the lander flies over.
//
// All errors are functions of place and seed. Those of heights and albedo are stationary Gaussian random fields on the
// sphere (gaussian_field.h), without borders or repetition; every other error has one value for the whole map.
//
// Order of operations, from the terrain to the map:
//
//   1. missing_craters_below_m   the detail loses craters below this diameter, and its rocks, fragments and clods
//   2. resolution_m              posts no closer than this: the pyramid's level of this spacing, or the next coarser
//   3. shift                     the ground is displaced along the surface
//   4. scale                     heights' distances from about.height_m are multiplied
//   5. tilt                      a plane through `about` is added
//   6. height                    the sum of its fields is added; heights stay within the bounds of lunar relief
//   7. albedo                    the albedo is multiplied by 1 + the sum of its fields, within 0 and 3.99
#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

namespace selenograph::dem {

class ValueMap;

struct MapError {
  // A product's layer of errors: the standard deviation of heights by place, m.
  struct Layer {
    std::string name;
    std::shared_ptr<const ValueMap> content;  // null: none
    bool operator==(const Layer&) const = default;
  };
  // A random field of zero mean. The sum of several has a spectrum of several scales; their variances add up.
  struct Field {
    double standard_deviation = 0;      // m of heights; a share of the albedo; with a layer the largest
    double correlation_length_m = 500;  // distance over which the correlation falls to 1/e, as exp(-(d/L)^2)
    Layer layer{};                      // the field's standard deviation by place; 0 where it has no data
    bool operator==(const Field&) const = default;
  };
  // Place where shift and tilt apply as stated, and height that the scale leaves unchanged.
  struct Place {
    double lat_deg = 0, lon_deg = 0, height_m = 0;
    bool operator==(const Place&) const = default;
  };
  // Displacement of the map's ground at `about`: a rotation about the Moon's centre, so that the map is not distorted.
  struct Shift {
    double north_m = 0, east_m = 0;
    bool operator==(const Shift&) const = default;
  };
  // Slope of the plane, which rises toward the azimuth (clockwise from north). With the distance d from `about` it
  // fades as exp(-d^2 / (2 kTiltReach_m^2)): by 0.5 % over 30 km.
  struct Tilt {
    double slope_deg = 0, azimuth_deg = 0;
    bool operator==(const Tilt&) const = default;
  };
  static constexpr double kTiltReach_m = 300e3;

  std::uint64_t seed = 0;  // of all fields; each has numbers of its own
  std::vector<Field> height{}, albedo{};
  Place about{};
  Shift shift{};
  Tilt tilt{};
  double scale = 1;
  double resolution_m = 0;             // 0: that of the terrain
  double missing_craters_below_m = 0;  // 0: none is missing
  bool operator==(const MapError&) const = default;

  bool is_shifted() const { return shift.north_m != 0 || shift.east_m != 0; }
};

}  // namespace selenograph::dem
