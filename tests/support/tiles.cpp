#include "tests/support/tiles.h"

#include <fmt/format.h>

#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <stdexcept>
#include <tuple>
#include <vector>

namespace selenograph::test {
namespace {

namespace fs = std::filesystem;

// A tile to be written, by whole degrees; its west is in 0..359.
struct Tile {
  int top, west, degrees, ppd;
  int side() const { return degrees * ppd; }
  double lat_deg(int row) const { return top - static_cast<double>(row) / ppd; }
  double lon_deg(int column) const { return west + static_cast<double>(column) / ppd; }
  std::string name() const {
    const auto lat = [](int deg) { return fmt::format("{}{:02}", deg < 0 ? 'S' : 'N', std::abs(deg)); };
    return fmt::format("DTM_MAP_{:02}_{}E{:03}{}E{:03}SC", degrees, lat(top), west, lat(top - degrees),
                       (west + degrees) % 360);
  }
};

void check(const Tile& tile) {
  const bool on_globe = tile.top <= 90 && tile.top - tile.degrees >= -90;
  if (!on_globe || tile.degrees < 1 || tile.degrees > 360 || tile.ppd < 1)
    throw std::invalid_argument("a tile of " + std::to_string(tile.degrees) + " degrees below latitude " +
                                std::to_string(tile.top) + " can't be");
}

std::vector<std::int16_t> posts_of(const Tile& tile, const HeightFunction& height_m, const VoidFunction& is_void) {
  std::vector<std::int16_t> posts;
  posts.reserve(static_cast<std::size_t>(tile.side()) * static_cast<std::size_t>(tile.side()));
  for (int r = 0; r < tile.side(); ++r)
    for (int c = 0; c < tile.side(); ++c) {
      const double lat = tile.lat_deg(r), lon = tile.lon_deg(c);
      const bool dummy = is_void && is_void(lat, lon);
      posts.push_back(dummy ? kTileDummy : static_cast<std::int16_t>(std::lround(height_m(lat, lon))));
    }
  return posts;
}

std::string label_of(const Tile& tile) {
  const int n = tile.side();
  const double north = tile.top, south = tile.lat_deg(n - 1), west = tile.west, east = tile.lon_deg(n - 1);
  std::string text;
  const auto add = [&](const std::string& key, const std::string& value) {
    text += fmt::format("{:<36} = {}\r\n", key, value);
  };
  const auto number = [&](const std::string& key, double value, const char* unit) {
    add(key, fmt::format("{:.6f} <{}>", value, unit));
  };
  add("PDS_VERSION_ID", "\"PDS3\"");
  add("RECORD_TYPE", "\"UNDEFINED\"");
  add("FILE_NAME", '"' + tile.name() + ".img\"");
  add("^IMAGE", fmt::format("(\"{}.img\", 1 <BYTES>)", tile.name()));
  add("MISSION_NAME", "\"SELENE\"");
  add("DATA_SET_ID", "\"SYNTHETIC-SELENOGRAPH-TEST-TERRAIN\"");
  add("PRODUCT_ID", '"' + tile.name() + '"');
  add("TARGET_NAME", "\"MOON\"");
  for (const auto& [corner, lat, lon] :
       {std::tuple("UPPER_LEFT", north, west), std::tuple("UPPER_RIGHT", north, east),
        std::tuple("LOWER_LEFT", south, west), std::tuple("LOWER_RIGHT", south, east)}) {
    number(std::string(corner) + "_LATITUDE", lat, "deg");
    number(std::string(corner) + "_LONGITUDE", lon, "deg");
  }
  add("OBJECT", "IMAGE_MAP_PROJECTION");
  add("MAP_PROJECTION_TYPE", "\"SIMPLE CYLINDRICAL\"");
  for (const char* axis : {"A", "B", "C"}) number(fmt::format("{}_AXIS_RADIUS", axis), 1737.4, "km");
  add("POSITIVE_LONGITUDE_DIRECTION", "\"EAST\"");
  number("CENTER_LATITUDE", 0, "deg");
  number("CENTER_LONGITUDE", 0, "deg");
  number("MAP_RESOLUTION", tile.ppd, "pixel/deg");
  number("MAXIMUM_LATITUDE", north, "deg");
  number("MINIMUM_LATITUDE", south, "deg");
  number("EASTERNMOST_LONGITUDE", east, "deg");
  number("WESTERNMOST_LONGITUDE", west, "deg");
  number("LINE_PROJECTION_OFFSET", north * tile.ppd, "pixel");
  number("SAMPLE_PROJECTION_OFFSET", -west * tile.ppd, "pixel");
  add("END_OBJECT", "IMAGE_MAP_PROJECTION");
  add("OBJECT", "IMAGE");
  add("BANDS", "1");
  add("LINES", std::to_string(n));
  add("LINE_SAMPLES", std::to_string(n));
  add("SAMPLE_TYPE", "MSB_INTEGER");
  add("SAMPLE_BITS", "16");
  add("OFFSET", "0.000000");
  add("SCALING_FACTOR", "1.000000");
  add("DUMMY", std::to_string(kTileDummy));
  add("UNIT", "\"m\"");
  add("END_OBJECT", "IMAGE");
  return text + "END\r\n";
}

void write_file(const fs::path& path, const std::string& bytes) {
  std::ofstream file(path, std::ios::binary | std::ios::trunc);
  file.write(bytes.data(), static_cast<std::streamsize>(bytes.size()));
  file.close();
  if (!file) throw std::runtime_error(path.string() + " can't be written");
}

}  // namespace

std::string write_kaguya_tile(const std::string& folder, int top_lat_deg, int west_lon_deg, int degrees,
                              int posts_per_degree, const HeightFunction& height_m, const VoidFunction& is_void) {
  const Tile tile{top_lat_deg, (west_lon_deg % 360 + 360) % 360, degrees, posts_per_degree};
  check(tile);
  fs::create_directories(folder);
  std::string bytes;
  for (const std::int16_t h : posts_of(tile, height_m, is_void)) {
    bytes.push_back(static_cast<char>(static_cast<std::uint16_t>(h) >> 8));
    bytes.push_back(static_cast<char>(static_cast<std::uint16_t>(h) & 0xFF));
  }
  write_file(fs::path(folder) / (tile.name() + ".img"), bytes);
  const fs::path label = fs::path(folder) / (tile.name() + ".lbl");
  write_file(label, label_of(tile));
  return label.string();
}

}  // namespace selenograph::test
