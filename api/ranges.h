// The numbers that a request may hold. The parser checks against these objects and the API document prints them.
#pragma once

#include <numbers>

#include "api/json_reader.h"

namespace selenograph::api {

inline constexpr Range kAnyNumber{};
inline constexpr Range kLatitude_deg{-90, 90};
inline constexpr Range kLongitude_deg{-180, 360};
inline constexpr Range kAzimuth_deg{-360, 360};
inline constexpr Range kElevation_deg{-90, 90};

// Below the deepest crater a place is a mistake; far out there is room for a camera at the Sun and beyond.
inline constexpr Range kHeight_m{-50e3, 1e12};
inline constexpr Range kCoordinate_m{-1e12, 1e12};

inline constexpr Range kFieldOfView_deg{0, 180, true, true};
// One pixel seen as anything from nearly a half-space to a nanoradian. A field of view must come out in here, too.
inline constexpr Range kFocalLength_px{1e-6, 1e9};
inline constexpr Range kPrincipalPoint_px{-1e6, 1e6};
inline constexpr Range kDistortion{-1e6, 1e6};

inline constexpr Range kDistance_au{0.01, 100};
inline constexpr Range kAngularRadius_deg{0, 5};
inline constexpr Range kUnitInterval{0, 1};
inline constexpr Range kWavelength_um{0, 1e4, true, false};
inline constexpr std::size_t kMaxResponsePoints = 10000;
inline constexpr Range kTemperature_k{0, 1e4};
inline constexpr Range kFNumber{0.1, 1000};
inline constexpr Range kSigma_px{0.01, 7};  // its kernel reaches 4.5 of these
inline constexpr Range kAngularRate_deg_s{-3600, 3600};
inline constexpr Range kVelocity_m_s{-1e6, 1e6};
inline constexpr Range kOffBoresight_deg{0, 90};
inline constexpr Range kShininess{0, 1e6};
inline constexpr Range kOppositionAmplitude{0, 10};
inline constexpr Range kOppositionWidth{0, 10, true, false};
inline constexpr Range kPhaseB{-1, 1, true, true};
inline constexpr Range kPhaseC{-2, 3};
inline constexpr Range kRoughness_deg{0, 60, false, true};
inline constexpr Range kMaxError_px{0, 100};
inline constexpr Range kBudget_ms{0, 3.6e6, true, false};
inline constexpr Range kMaxShadowError_px{0, 1e6};
// Cameras of a round trip: from a metre above the ground to beyond the Earth.
inline constexpr Range kStationHeight_m{1, 1e9};
inline constexpr Range kFootprintRatio{0.1, 10};
inline constexpr Range kFullScaleRadiance{0, 1e12, true, false};

// How far a quaternion's length may be from 1: room for rounding (and for float32), not for a forgotten normalisation.
inline constexpr double kQuaternionTolerance = 1e-3;

}  // namespace selenograph::api
