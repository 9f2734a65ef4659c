// A PDS3 product: label and pixels. The input is the label file as it is; what follows its first NUL byte is the data
// file "tile.img" beside it, too. So both attached and detached labels find pixels.
#include <algorithm>
#include <bit>
#include <filesystem>
#include <fstream>
#include <string>
#include <vector>

#include "dem/base/error.h"
#include "dem/files/pds_image.h"
#include "dem/gdal/raster.h"
#include "tests/fuzz/fuzz.h"
#include "tests/support/shared_data.h"

namespace selenograph::fuzz {
namespace {

using namespace dem;

void write(const std::string& path, std::string_view bytes) {
  std::ofstream(path, std::ios::binary).write(bytes.data(), static_cast<std::streamsize>(bytes.size()));
}

void check_info(const RasterInfo& info, const std::string& path) {
  require(info.path == path && info.name == "tile", "the file is named");
  require(info.width > 0 && info.height > 0, "there are posts");
  require(std::isfinite(info.posts_per_degree) && info.posts_per_degree > 0 && std::isfinite(info.post_spacing_m) &&
              info.post_spacing_m > 0,
          "the spacing is positive");
  const Footprint& f = info.footprint;
  require(f.south_deg >= -90 && f.south_deg <= f.north_deg && f.north_deg <= 90, "latitudes are in order");
  require(f.west_deg >= -180 && f.west_deg < 180 && f.east_deg >= f.west_deg && f.east_deg <= f.west_deg + 360,
          "longitudes are in order");
  require(info.quantisation_m >= 0 && std::isfinite(info.quantisation_m), "quantisation is a step");
  require(!info.lattice_level || (*info.lattice_level >= 0 && *info.lattice_level <= 24), "the lattice level is one");
}

// Posts to places and back, at the corners; to a hundredth of a post, or what is left of double far from the prime
// meridian with very many posts per degree.
void check_places(const RasterInfo& info) {
  const double tolerance = 0.01 + 1e-11 * info.posts_per_degree;
  for (const int x : {0, info.width - 1})
    for (const int y : {0, info.height - 1}) {
      const Geographic place = place_of_post(info, x, y);
      require(std::isfinite(place.lat_deg) && place.lon_deg >= -180 && place.lon_deg < 180, "a post is at a place");
      if (std::abs(place.lat_deg) > 89.9 || info.projection() != Projection::geographic) continue;
      const PostXY back = locate(info, place.lat_deg, place.lon_deg);
      const double period = info.wraps_longitude ? info.width : 360 * info.posts_per_degree;
      require(std::abs(std::remainder(back.x - x, period)) < tolerance && std::abs(back.y - y) < tolerance,
              "places lead back to posts");
    }
}

struct Window {
  int x, y, w, h;
};

std::vector<float> read(Raster& raster, const Window& window) {
  // Not NaN: what is left unwritten is found.
  std::vector<float> heights(static_cast<std::size_t>(window.w) * static_cast<std::size_t>(window.h), 12345.5F);
  raster.read(window.x, window.y, window.w, window.h, heights.data());
  return heights;
}

void check_posts(const RasterInfo& info) {
  Raster raster(info);
  const Window whole{-3, -3, std::min(info.width, 40) + 6, std::min(info.height, 40) + 6};
  const std::vector<float> heights = read(raster, whole);
  for (const float h : heights)
    require(std::isnan(h) || std::abs(h) <= kFarthestHeight_m, "a post is void or a height on the Moon");
  // Whatever is read at once, a post has one value.
  for (const Window part : {Window{0, 0, 1, 1}, Window{whole.x + 1, whole.y + 2, whole.w - 1, 3},
                            Window{info.width - 1, info.height - 1, 2, 2}}) {
    const std::vector<float> again = read(raster, part);
    for (int j = 0; j < part.h; ++j)
      for (int i = 0; i < part.w; ++i) {
        const int c = part.x + i - whole.x, r = part.y + j - whole.y;
        if (c < 0 || r < 0 || c >= whole.w || r >= whole.h) continue;
        const float a =
            heights[static_cast<std::size_t>(r) * static_cast<std::size_t>(whole.w) + static_cast<std::size_t>(c)];
        const float b =
            again[static_cast<std::size_t>(j) * static_cast<std::size_t>(part.w) + static_cast<std::size_t>(i)];
        require(std::bit_cast<std::uint32_t>(a) == std::bit_cast<std::uint32_t>(b), "a post has one value");
      }
  }
}

}  // namespace
}  // namespace selenograph::fuzz

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace selenograph;
  static const test::TemporaryFolder folder;
  static const std::string path = folder / "tile.lbl", data_path = folder / "tile.img";
  const std::string_view input = fuzz::text_of(data, size);
  const std::size_t nul = input.find('\0');
  fuzz::write(path, input);
  if (nul != std::string_view::npos) {
    fuzz::write(data_path, input.substr(nul + 1));
  } else {
    std::filesystem::remove(data_path);
  }
  try {
    // Not inspect_raster at once: it would look at what is no PDS3 label with GDAL.
    const dem::PdsObject label = dem::parse_pds_label(input.substr(0, nul), path);
    dem::describe_pds_image(label, path);
    const dem::RasterInfo info = dem::inspect_raster(path);
    fuzz::check_info(info, path);
    fuzz::check_places(info);
    fuzz::check_posts(info);
  } catch (const DataError& error) {
    fuzz::require(error.file() == path, "the error names the file:", error.what());
  }
  return 0;
}
