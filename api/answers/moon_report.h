// Reports of `verify moon`: rows as CSV, and a page of tables.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "engine/verify/disc_image.h"
#include "engine/verify/moon_disc.h"

namespace selenograph::api {

// A real image, one of its channels, and the frame beside it.
struct ImageRow {
  std::string image, channel;
  double wavelength_um;
  engine::DiscComparison comparison;
  engine::Placement registration;
};

struct MoonReport {
  std::vector<engine::DiscRow> discs;
  std::vector<engine::ReliefRow> relief;
  std::vector<ImageRow> images;
  double point_spread_px = 0;  // standard deviation, fitted to all images
};

// A header line, then one line per row; empty where a model has no value.
std::string disc_csv(const MoonReport& report);
std::string relief_csv(const MoonReport& report);
std::string images_csv(const MoonReport& report);

// Tables: ratios to LIME and ROLO by phase angle, relief, images.
std::string moon_markdown(const MoonReport& report);

// Values outside the stated bounds, a line each; empty: none. `moon` on a sphere against LIME, 1 % from 5 degrees on
// and 2 % below; on terrain, as the mean of waxing and waning, 3 %; images: correlation 0.995 below 1 um and 0.985
// above, scale within 10 % and the same on all dates within 2 %, limb within 0.1 pixels.
std::vector<std::string> beyond_bounds(const MoonReport& report);

}  // namespace selenograph::api
