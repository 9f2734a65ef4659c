// Sun and Earth above the horizons of a map or of places over a time span: means, nights, and series.
#pragma once

#include <string>
#include <vector>

#include "engine/horizons/disc_shares.h"

namespace selenograph::engine {

// Epochs in equal steps, and where the bodies are at them.
struct BodySeries {
  std::vector<BodyEpoch> sun, earth;  // of the same length
  double step_s = 3600;
};

// Returns the bodies at UTC epochs. Throws ImpossibleRequest as sun_at.
BodySeries bodies_at(const std::vector<std::string>& utc, double step_s);

// A year at each pixel of a map or each place; NaN without data. An epoch lasts one step.
struct Illumination {
  std::vector<float> sun_mean, earth_mean;  // mean shares of the discs, 0 to 1
  std::vector<float> longest_night_h;       // longest run of epochs without any of the Sun's disc
  std::vector<float> nights;                // number of such runs, also those cut by the span's ends
  std::vector<float> longest_without_earth_h;
  HorizonReport report;
};

// Finds the illumination of a map's pixels. Stores nothing but the answer.
Illumination illumination_of_map(const dem::MapGrid& grid, const HorizonOptions& options, const BodySeries& bodies,
                                 const RenderContext& context, const HorizonProgress& progress = {});

// Shares at single places: [epoch * places + place]; NaN without data.
struct IlluminationSeries {
  std::vector<float> sun, earth;
  Illumination summary;  // of each place
};
IlluminationSeries illumination_of_places(std::span<const Vec3> places, const HorizonOptions& options,
                                          const BodySeries& bodies, const RenderContext& context,
                                          const HorizonProgress& progress = {});

}  // namespace selenograph::engine
