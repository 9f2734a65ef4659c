// Tiles in Kaguya's on-disk format with whatever terrain a test needs.
#pragma once

#include <cstdint>
#include <functional>
#include <string>

namespace selenograph::test {

// Functions of a place: its height in m, and whether its post is void.
using HeightFunction = std::function<double(double lat_deg, double lon_deg)>;
using VoidFunction = std::function<bool(double lat_deg, double lon_deg)>;

inline constexpr std::int16_t kTileDummy = -9999;

// Writes <name>.img (big-endian int16, whole metres) and <name>.lbl (detached PDS3 label, CRLF) into `folder`, made if
// missing, and returns the label's path. As in the archive, the first post lies on the tile's north-west corner and the
// last one 1/ppd short of its south-east corner: the tile holds latitudes top .. top - degrees + 1/ppd. Posts for which
// `is_void` returns true are DUMMY. The name is the archive's: DTM_MAP_<degrees>_N01E000N00E001SC; longitudes are
// brought into 0..360. Throws std::runtime_error when a file can't be written, std::invalid_argument for a tile that
// can't be.
std::string write_kaguya_tile(const std::string& folder, int top_lat_deg, int west_lon_deg, int degrees,
                              int posts_per_degree, const HeightFunction& height_m, const VoidFunction& is_void = {});

}  // namespace selenograph::test
