// Sample terrain: a synthetic lunar landscape, written as SLDEM2013 tiles (PDS3).
#pragma once

#include <cstdint>
#include <functional>
#include <string>
#include <vector>

namespace selenograph::dem {

// Options of the sample. The default area was chosen by eye: a crater of 38 km with a central peak, cratered highlands
// around it and the shore of a mare in the south-west.
struct SampleOptions {
  std::uint64_t seed = 2;
  // South-west corner and size of the mosaic in whole 1-degree tiles (SLDEM2013 naming, DTM_MAP_01_N01E000N00E001SC).
  int south_deg = -8, west_deg = 39;
  int rows = 3, columns = 2;
  // Posts per degree, a power of two. 4096 is SLDEM2013's own (7.4 m); the default keeps the sample small and quick.
  int posts_per_degree = 1024;
  // Also writes tiles on both sides of the 180th meridian (E179..E180, E180..E181), for tests of the seam.
  bool date_line = false;
};

// Writes tiles (.img big-endian int16, .lbl detached PDS3 with CRLF) into `folder`, created if missing; returns the
// label paths. Equal options give equal bytes. Each file is written atomically (temporary name, then rename).
// `progress` gets 0..1, from the calling thread. Tiles are independent: a tile has the same bytes alone and in any
// mosaic, and agrees with its neighbours. Throws std::invalid_argument for impossible options, DataError when a file
// cannot be written.
std::vector<std::string> write_sample_terrain(const std::string& folder, const SampleOptions& options,
                                              const std::function<void(double)>& progress = {});

}  // namespace selenograph::dem
