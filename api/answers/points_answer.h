// Answers for rays, landmarks and heights.
#pragma once

#include <span>
#include <string>

#include "api/encode/negotiate.h"
#include "api/requests/points_json.h"
#include "api/schema/answers.h"
#include "dem/catalogue/catalogue.h"
#include "engine/rays/light_at_places.h"

namespace selenograph::api {

// Irradiance of a point; empty without indirect light and where the point is not on terrain.
using LightOfPoint = std::optional<engine::Irradiance>;

// Adds what is known of the map's errors to an answer from a map with errors.
OrderedJson with_map_error(OrderedJson answer, const std::optional<MapErrorQuery>& map_error);

// Input of the answer for one ray.
struct HitSource {
  const engine::RayHit& hit;
  const LightOfPoint& light;
  const RaysQuery& query;
};
const Answer<HitSource>& hit_answer();
OrderedJson rays_json(std::span<const engine::RayHit> hits, std::span<const LightOfPoint> light,
                      const RaysQuery& query);

// Returns arrays of the query's shape, with NaN for missing values; `object` is 65535 for terrain and rocks, `rock` is
// 0 for none.
std::string rays_npz(std::span<const engine::RayHit> hits, std::span<const LightOfPoint> light, const RaysQuery& query,
                     const StopToken& stop);

// Media types of the answers, in the order of the server's preference.
inline constexpr Alternative kRaysAnswers[] = {
    {"application/json", "a list of hits, each with its members"},
    {"application/x-npz",
     "the same as arrays of the rays' shape, NaN where nothing is hit: `hit`, `range_m`, `position_m`, `normal`, "
     "`rock` "
     "(its id as a whole number, in hexadecimal that of POST /v1/features; 0: none), `object` (65535: none), `lit`, "
     "`irradiance`"},
};
inline constexpr Alternative kLandmarkAnswers[] = {
    {"application/json", "a list of landmarks, each with its members"},
    {"application/x-npz",
     "the same as arrays of the points' shape, NaN for null: `x_px`, `y_px`, `range_m`, `height_m`, `in_frame`, "
     "`visible`, `time_s`, `lit`, `irradiance`, `reason` (0: none, 1: no dataset covers the place, 2: the datasets "
     "have "
     "no valid post, 3: behind the camera, 4: beyond the lens's field of view, 5: seen by no row)"},
};

// Input of the answer for one landmark.
struct LandmarkSource {
  const engine::Landmark& landmark;
  const LightOfPoint& light;
  const engine::LandmarkQuery& point;
  const ProjectQuery& query;
  const dem::Catalogue& catalogue;
};
const Answer<LandmarkSource>& landmark_answer();
OrderedJson landmarks_json(std::span<const engine::Landmark> landmarks, std::span<const LightOfPoint> light,
                           const ProjectQuery& query, const dem::Catalogue& catalogue);
std::string landmarks_npz(std::span<const engine::Landmark> landmarks, std::span<const LightOfPoint> light,
                          const ProjectQuery& query, const dem::Catalogue& catalogue, const StopToken& stop);

// Input of the answer for one place.
struct HeightSource {
  const dem::HeightAnswer& height;
  const dem::Catalogue& catalogue;
  bool has_height() const;  // false without a valid post
};
const Answer<HeightSource>& height_answer();

}  // namespace selenograph::api
