// Ranges shared by several members of requests, or used in checks across members. All other ranges are in their
// members' rows.
#pragma once

#include <cstdint>

#include "api/json/json_reader.h"

namespace selenograph::api {

inline constexpr Range kAnyNumber{};
inline constexpr Range kLatitude_deg{-90, 90};
inline constexpr Range kLongitude_deg{-180, 360};
inline constexpr Range kAzimuth_deg{-360, 360};
inline constexpr Range kElevation_deg{-90, 90};

// The lower limit is below the deepest crater; the upper one allows for a camera at the Sun and beyond.
inline constexpr Range kHeight_m{-50e3, 1e12};
inline constexpr Range kCoordinate_m{-1e12, 1e12};

inline constexpr Range kFieldOfView_deg = above(0).below(180);
inline constexpr Range kFisheyeFieldOfView_deg = above(0).to(358);  // up to engine::Fisheye::kWidest
// A pixel may cover anything from nearly a half-space to a nanoradian. Focal lengths from a field of view must be in
// this range, too.
inline constexpr Range kFocalLength_px{1e-6, 1e9};
inline constexpr Range kPrincipalPoint_px{-1e6, 1e6};
inline constexpr Range kDistortion{-1e6, 1e6};

inline constexpr Range kDistance_au{0.01, 100};
inline constexpr Range kAngularRadius_deg{0, 5};
inline constexpr Range kUnitInterval{0, 1};
inline constexpr Range kWavelength_um = above(0).to(1e4);
inline constexpr Range kTemperature_k{0, 1e4};
inline constexpr Range kFNumber{0.1, 1000};
inline constexpr Range kMaxError_px{0, 100};
// Height of a round trip's cameras above the ground, from 1 m to beyond the Earth.
inline constexpr Range kStationHeight_m{1, 1e9};
inline constexpr Range kFootprintRatio{0.1, 10};

inline constexpr std::int64_t kMaxSeed = std::int64_t{1} << 53;  // every integer up to here is exact in a JSON number

// Tolerance of a quaternion's length. It admits rounding, also to float32, but not a missing normalisation.
inline constexpr double kQuaternionTolerance = 1e-3;

}  // namespace selenograph::api
