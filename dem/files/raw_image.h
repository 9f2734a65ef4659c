// Samples in a file, as a label of any format describes them.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "dem/grid/geodesy.h"
#include "dem/grid/post_grid.h"

namespace selenograph::dem {

// Type of a stored sample.
struct RawSample {
  int bytes = 2;
  bool real = false, has_sign = true, little_endian = false;
};

// Image in a file without format headers: position and meaning of its samples.
struct RawImage {
  std::string data_path;         // path of the label if it is attached
  std::uint64_t first_byte = 0;  // offset of the first sample
  std::uint64_t row_bytes = 0;   // stride of rows
  int width = 0, height = 0;
  RawSample sample;
  // metres = (sample * scale + offset) * unit_m
  double scale = 1, offset = 0, unit_m = 1;
  std::vector<double> voids;        // sample values that mean no-data
  std::string format;               // e.g. "PDS3 Kaguya"
  bool synthetic = false;           // the label marks the terrain as generated
  std::string quantity;             // words for the samples' quantity, e.g. "HEIGHT"; empty: none
  std::string product;              // the product's identifier, e.g. "LDEM_4"; empty: none
  double sphere_m = kMoonRadius_m;  // radius of the map's sphere
  PostGrid grid;
};

}  // namespace selenograph::dem
