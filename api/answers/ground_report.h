// Reports of `verify ground`: rows as CSV, and a page of tables.
#pragma once

#include <string>
#include <vector>

#include "engine/verify/ground.h"

namespace selenograph::api {

// Slopes by baseline, craters and rocks by octave of diameter, albedo and roughness, measured on a detail's ground.
struct GroundReport {
  std::string detail;  // name of the detail
  std::vector<engine::SlopeRow> slopes;
  std::vector<engine::CraterRow> craters;
  std::vector<engine::AlbedoRow> albedo;
  std::vector<engine::RockRow> rocks;
  std::vector<engine::RoughnessRow> roughness;
};

// Return CSV: a header line, then one line per row, with empty cells for missing values. Lengths are in m, numbers per
// km^2.
std::string slopes_csv(const GroundReport& report);
std::string craters_csv(const GroundReport& report);
std::string albedo_csv(const GroundReport& report);
std::string rocks_csv(const GroundReport& report);

std::string ground_markdown(const GroundReport& report);

// Returns a line for each value outside its bounds. The bounds: median slopes up to 100 m within 20 % of the published
// ones, Hurst exponents from 1 to 100 m within 0.65 to 1.05; where the published slope over 0.5 m is below 5 degrees,
// Hurst exponents below 0.5 m within 0.55 to 0.85 and slopes over 7 mm as Chang'e-4 measured them; visible craters of
// octaves from 2 to 50 m within 0.8 to 1.25 of the law, areas of rocks of octaves up to 4 m within 0.85 to 1.15 of it,
// median RMS heights in windows of 125 mm that include 2.5 to 5 mm, a mean factor of the albedo within 3 % of 1.
std::vector<std::string> bound_violations(const GroundReport& report);

}  // namespace selenograph::api
