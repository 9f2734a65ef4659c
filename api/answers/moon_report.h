// Reports of `verify moon`: rows as CSV, and a page of tables.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "engine/verify/disc_image.h"
#include "engine/verify/moon_disc.h"

namespace selenograph::api {

// A channel of a real image, compared with a rendered frame.
struct ImageRow {
  std::string image, channel;
  double wavelength_um;
  engine::DiscComparison comparison;
  engine::Placement registration;
};

// Everything that `verify moon` compares: discs with models, terrain with smooth ground, frames with images.
struct MoonReport {
  std::vector<engine::DiscRow> discs;
  std::vector<engine::ReliefRow> relief;
  std::vector<ImageRow> images;
  double point_spread_px = 0;  // standard deviation, fitted to all images
};

// Return CSV: a header line, then one line per row, with empty cells for NaN.
std::string disc_csv(const MoonReport& report);
std::string relief_csv(const MoonReport& report);
std::string images_csv(const MoonReport& report);

// Returns a page of tables: ratios to LIME and ROLO by phase angle, relief, images.
std::string moon_markdown(const MoonReport& report);

// Returns a line for each value outside its bounds. The bounds: `moon` on a sphere differs from LIME by 1 % from 5
// degrees on and by 2 % below; on terrain, as the mean of waxing and waning, by 3 %. Images have a correlation of 0.995
// below 1 um and 0.985 above, a scale within 10 % and equal on all dates within 2 %, and the limb within 0.1 pixels.
std::vector<std::string> bound_violations(const MoonReport& report);

}  // namespace selenograph::api
