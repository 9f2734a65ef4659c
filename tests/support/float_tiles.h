// Tiles of floating-point heights with any post spacing and size: what whole metres in Kaguya's format can't express.
#pragma once

#include <filesystem>
#include <fstream>
#include <memory>
#include <string>

#include "dem/terrain/pyramid_terrain.h"
#include "tests/support/tiles.h"

namespace selenograph::test {

struct FloatTile {
  double north_deg = 0, west_deg = 0;  // place of the first post
  double posts_per_degree = 16;
  int rows = 0, columns = 0;
};

// Writes posts at (north - r / ppd, west + c / ppd) as little-endian float32, with a PDS3 label of Kaguya's kind.
// Returns the label's path.
inline std::string write_float_tile(const std::string& folder, const std::string& name, const FloatTile& t,
                                    const HeightFunction& height_m, const VoidFunction& is_void = {}) {
  std::filesystem::create_directories(folder);
  std::ofstream data(folder + "/" + name + ".img", std::ios::binary);
  for (int r = 0; r < t.rows; ++r)
    for (int c = 0; c < t.columns; ++c) {
      const double lat = t.north_deg - r / t.posts_per_degree, lon = t.west_deg + c / t.posts_per_degree;
      const float h = is_void && is_void(lat, lon) ? -99999.F : static_cast<float>(height_m(lat, lon));
      data.write(reinterpret_cast<const char*>(&h), sizeof h);
    }
  const auto line = [](const std::string& key, double v) { return key + " = " + std::to_string(v) + "\r\n"; };
  std::ofstream(folder + "/" + name + ".lbl", std::ios::binary)
      << "PDS_VERSION_ID = \"PDS3\"\r\nMISSION_NAME = SELENE\r\n^IMAGE = (\"" + name + ".img\", 1 <BYTES>)\r\n" +
             "OBJECT = IMAGE_MAP_PROJECTION\r\nMAP_PROJECTION_TYPE = \"SIMPLE CYLINDRICAL\"\r\n" +
             line("MAP_RESOLUTION", t.posts_per_degree) + line("MAXIMUM_LATITUDE", t.north_deg) +
             line("MINIMUM_LATITUDE", t.north_deg - (t.rows - 1) / t.posts_per_degree) +
             line("WESTERNMOST_LONGITUDE", t.west_deg) +
             line("EASTERNMOST_LONGITUDE", t.west_deg + (t.columns - 1) / t.posts_per_degree) +
             line("LINE_PROJECTION_OFFSET", t.north_deg * t.posts_per_degree) +
             line("SAMPLE_PROJECTION_OFFSET", -t.west_deg * t.posts_per_degree) +
             "END_OBJECT = IMAGE_MAP_PROJECTION\r\nOBJECT = IMAGE\r\n" + line("LINES", t.rows) +
             line("LINE_SAMPLES", t.columns) +
             "SAMPLE_TYPE = PC_REAL\r\nSAMPLE_BITS = 32\r\nDUMMY = -99999\r\nEND_OBJECT = IMAGE\r\nEND\r\n";
  return folder + "/" + name + ".lbl";
}

// Writes a tile of the whole Moon, from pole to pole. Four posts per degree make a file of 4 MB.
inline void write_global_tile(const std::string& folder, double posts_per_degree, const HeightFunction& height_m) {
  const int n = static_cast<int>(posts_per_degree);
  write_float_tile(folder, "global", {90, 0, posts_per_degree, 180 * n + 1, 360 * n}, height_m);
}

inline std::shared_ptr<dem::PyramidTerrain> open_terrain(const std::string& folder, const std::string& cache_dir = {},
                                                         bool fall_through = false) {
  return std::make_shared<dem::PyramidTerrain>(dem::Catalogue(std::vector<std::string>{folder}),
                                               dem::TerrainOptions{cache_dir, std::size_t{512} << 20, fall_through});
}

}  // namespace selenograph::test
