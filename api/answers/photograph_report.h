// Report of `verify photographs`: rows of measures with their bounds, for the Sun and for a wrong one.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "engine/verify/photograph_measures.h"

namespace selenograph::api {

struct PhotographComparison {
  std::vector<double> tie_distances_px;  // of the ties held out from the view's fit
  engine::PhotographMeasures measures;
};

struct PhotographRow {
  std::string name;
  double pixel_m, post_m;  // sizes on the ground
  bool is_radiance;        // the photograph holds radiance, not a film's or an unknown camera's values
  PhotographComparison sun, wrong_sun;
};

struct PhotographReport {
  std::vector<PhotographRow> rows;
  std::vector<std::string> skipped;  // "NAME: why"
};

// A measure of a photograph and its value under both Suns.
struct PhotographMeasure {
  std::string photograph, name;
  double low, high;  // bounds of `value`
  double value, wrong_sun;
  bool is_within_bounds() const { return value >= low && value <= high; }
  // Returns true if the control does what it must: a frame with a wrong Sun misses the bounds.
  bool wrong_sun_fails() const { return !(wrong_sun >= low && wrong_sun <= high); }
};

// Returns the measures that apply to each photograph: ties and tone, shadows where they are 1 % of the photograph or
// more, and of radiance its ratio. A strip of radiance without 30 ties has its ratio alone.
std::vector<PhotographMeasure> measures_of(const PhotographReport& report);

std::string photographs_csv(const PhotographReport& report);
std::string photographs_markdown(const PhotographReport& report);

// Returns a line for each measure outside its bounds and for each whose control is within them.
std::vector<std::string> bound_violations(const PhotographReport& report);

}  // namespace selenograph::api
