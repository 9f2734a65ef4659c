// What a PDS3 label of a Kaguya or LOLA product says about its pixels and where they lie.
//
// The georeferencing of PDS3 products comes from here and not from GDAL, whose driver ignores DUMMY and mirrors tiles
// that carry the old positive sign of SAMPLE_PROJECTION_OFFSET. Keywords: Planetary Science Data Dictionary.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "dem/files/pds_label.h"
#include "dem/grid/post_grid.h"

namespace selenograph::dem {

struct PdsSample {
  int bytes = 2;
  bool real = false, has_sign = true, little_endian = false;
};

struct PdsImage {
  std::string data_path;         // the label itself when it is attached
  std::uint64_t first_byte = 0;  // of the first sample
  std::uint64_t row_bytes = 0;   // from one row's first sample to the next row's
  int width = 0, height = 0;
  PdsSample sample;
  // metres = (sample * scale + offset) * unit_m
  double scale = 1, offset = 0, unit_m = 1;
  std::vector<double> voids;  // sample values that are no heights
  std::string format;         // "PDS3 Kaguya", "PDS3 LOLA" or "PDS3"
  PostGrid grid;
};

// Everything needed to read the posts. Throws DataError naming the label when it contradicts itself, is not about
// heights on the 1737.4 km sphere or uses a projection or sample type that isn't supported, and when the data file is
// missing or shorter than the label says.
PdsImage describe_pds_image(const PdsObject& label, const std::string& label_path);

}  // namespace selenograph::dem
