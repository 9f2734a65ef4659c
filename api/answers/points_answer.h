// Answers for rays, landmarks and heights.
#pragma once

#include <span>

#include "api/requests/points_json.h"
#include "api/schema/answers.h"
#include "dem/catalogue/catalogue.h"

namespace selenograph::api {

using LightOfPoint = std::optional<engine::Irradiance>;

struct HitSource {
  const engine::RayHit& hit;
  const LightOfPoint& light;
  const RaysQuery& query;
};
const Answer<HitSource>& hit_answer();
OrderedJson rays_json(std::span<const engine::RayHit> hits, std::span<const LightOfPoint> light,
                      const RaysQuery& query);

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

struct HeightSource {
  const dem::HeightAnswer& height;
  const dem::Catalogue& catalogue;
  bool known() const;  // whether there is a valid post
};
const Answer<HeightSource>& height_answer();

}  // namespace selenograph::api
