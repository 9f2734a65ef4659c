// From a label and an image in a folder to the terrain: catalogue, pyramid, posts. The input is as that of pds_tile:
// the label, and behind its first NUL byte the data file "tile.img". What begins as a TIFF or a VRT is
// one, "tile.tif" or "tile.vrt". Beside them lies a sound tile of the layer below.
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <string>
#include <vector>

#include "dem/base/error.h"
#include "dem/files/pds_image.h"
#include "dem/gdal/raster.h"
#include "dem/posts/post_source.h"
#include "dem/terrain/pyramid_terrain.h"
#include "tests/fuzz/fuzz.h"
#include "tests/support/shared_data.h"
#include "tests/support/tiles.h"

namespace selenograph::fuzz {
namespace {

using namespace dem;

constexpr double kBelow_m = -1234;

struct Folder {
  Folder() {
    test::write_kaguya_tile(folder.path(), 12, 0, 12, 1, [](double, double) { return kBelow_m; });
  }
  test::TemporaryFolder folder;
  std::string label = folder / "tile.lbl", image = folder / "tile.img", tiff = folder / "tile.tif",
              vrt = folder / "tile.vrt";
};

void write(const std::string& path, std::string_view bytes) {
  std::ofstream(path, std::ios::binary).write(bytes.data(), static_cast<std::streamsize>(bytes.size()));
}

// A pyramid of very fine posts, or of the whole Moon, takes seconds: not here.
bool is_small(const RasterInfo& info) {
  const Footprint& f = info.footprint;
  return level_needed(info) <= kRootLevel + 2 && f.north_deg - f.south_deg < 9 && f.east_deg - f.west_deg < 9 &&
         std::abs(f.south_deg) < 70 && std::abs(f.north_deg) < 70;
}

void check_height(const HeightAnswer& answer, std::size_t rasters) {
  require(std::isnan(answer.height_m) == (answer.source < 0), "a height has a source");
  if (answer.source < 0) return;
  require(static_cast<std::size_t>(answer.source) < rasters, "which is in the catalogue");
  require(answer.height_m >= static_cast<double>(kLowestRelief_m) - 1 &&
              answer.height_m <= static_cast<double>(kHighestRelief_m) + 1,
          "a height is one of the Moon");
  require(answer.post_spacing_m > 0 && std::isfinite(answer.post_spacing_m), "posts have a spacing");
}

bool is_height(float post) { return post >= kLowestRelief_m && post <= kHighestRelief_m; }

// Whether a post is a corner of a quad of heights: of triangles, whichever way it is cut.
bool has_quad(Raster& raster, const RasterInfo& info, int x, int y) {
  for (const int y0 : {y - 1, y})
    for (const int x0 : {x - 1, x}) {
      if (x0 < 0 || y0 < 0 || x0 + 1 >= info.width || y0 + 1 >= info.height) continue;
      std::array<float, 4> posts{};
      raster.read(x0, y0, 2, 2, posts.data());
      if (std::all_of(posts.begin(), posts.end(), is_height)) return true;
    }
  return false;
}

// What is in the file is on the terrain: a tile that is in the catalogue is no hole.
void check_terrain(const Catalogue& catalogue, const RasterInfo& info) {
  const PyramidTerrain terrain(catalogue, {});
  Raster raster(info);
  for (const int y : {0, info.height / 2, info.height - 1})
    for (const int x : {0, info.width / 2, info.width - 1}) {
      float post = 0;
      raster.read(x, y, 1, 1, &post);
      const Geographic place = place_of_post(info, x, y);
      const HeightAnswer answer = terrain.height(place.lat_deg, place.lon_deg);
      check_height(answer, catalogue.rasters().size());
      if (!info.lattice_level || !is_height(post)) continue;
      // A post without valid ones beside it may be no corner of a triangle.
      if (answer.source < 0 && !has_quad(raster, info, x, y)) continue;
      // Whatever the layer below does, posts of this one are unchanged.
      constexpr double kRounding_m = 1e-2;
      require(std::abs(answer.height_m - static_cast<double>(post)) < kRounding_m,
              "a post of the file is one of the terrain",
              fmt::format("post ({}, {}) at {} N, {} E: {} m, the terrain {} m{}", x, y, place.lat_deg, place.lon_deg,
                          post, answer.height_m, answer.blended ? ", bent" : ""));
    }
  const BlockId block =
      block_at(2, static_cast<Tick>((info.footprint.south_deg + 90) * kTicksPerDegree),
               wrap_lon(static_cast<std::int64_t>((info.footprint.west_deg + 180) * kTicksPerDegree)));
  const NodeInfo node = terrain.node(block);
  require(node.empty || (node.min_m <= node.max_m && std::isfinite(node.error_m)), "a block has bounds");
}

// `path`: of the label or of the georeferenced file.
void check(const Folder& in, const std::string& path) {
  const Catalogue catalogue({in.folder.path()});
  const auto index = catalogue.find(path);
  const auto& problems = catalogue.problems();
  const bool told = std::any_of(problems.begin(), problems.end(), [&](const CatalogueProblem& p) {
    return (p.path == path || p.path == in.image) && !p.what.empty();
  });
  require(index || told || (path == in.label && !describes_map(read_pds_label(path))),
          "a tile is in the catalogue or a problem, or both");
  if (!index) return;
  const RasterInfo& info = catalogue.rasters()[*index];
  require(info.damage.empty() == !told, "damage is a problem");
  require(std::isfinite(info.quantisation_m), "quantisation is a step");
  if (!is_small(info)) return;
  try {
    check_terrain(catalogue, info);
  } catch (const DataError& error) {
    // A GeoTIFF's posts may turn out to be damaged when they are read.
    require(error.file() == path && (path != in.label || !info.damage.empty()),
            "what is damaged is named, and was known to be:", error.what());
  }
}

}  // namespace
}  // namespace selenograph::fuzz

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace selenograph;
  static const fuzz::Folder in;
  const std::string_view input = fuzz::text_of(data, size);
  for (const std::string& old : {in.label, in.image, in.tiff, in.vrt}) std::filesystem::remove(old);
  const bool tiff = input.starts_with("II") || input.starts_with("MM"), vrt = input.starts_with("<VRTDataset");
  const std::string& path = tiff ? in.tiff : vrt ? in.vrt : in.label;
  fuzz::write(path, input);
  if (const std::size_t nul = input.find('\0'); path == in.label && nul != std::string_view::npos)
    fuzz::write(in.image, input.substr(nul + 1));
  try {
    fuzz::check(in, path);
  } catch (const DataError& error) {
    // read_pds_label's: no label at all, which the catalogue has told.
    fuzz::require(error.file() == in.label, "the error names the file:", error.what());
  }
  return 0;
}
