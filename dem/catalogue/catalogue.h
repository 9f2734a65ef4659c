// Catalogue of DEM files and their footprints: a lookup without open files.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "dem/catalogue/catalogue_opening.h"
#include "dem/files/raster_info.h"
#include "dem/grid/block.h"

namespace selenograph::dem {

// Parameters for joining layers of different resolution: see layer_bends.h.
struct LayerJoins {
  // Width of the band in which the coarser layer bends, in posts of that layer; 0: it does not bend.
  double blend_posts = 16;
  // Offsets added to the heights of each raster, m, by its index; empty: none.
  std::vector<double> offsets_m{};
  // Spacing of the heights that each raster resolves, in its posts (resolved_posts.h); empty: 1.
  std::vector<double> resolved_posts{};
};

// Immutable after join_layers(): concurrent reads need no lock.
class Catalogue {
 public:
  // Opens the files of `paths`: files, folders (searched recursively), or remote GeoTIFFs by GDAL's names
  // ("/vsicurl/https://...", as permitted by allow_remote_files()). Label and data of one PDS product are one entry. A
  // file named explicitly that cannot be used throws DataError; one found in a folder becomes a problem. Throws
  // SystemFault when the system or a connection fails.
  //
  // Entries are sorted from coarse to fine. Entries of equal resolution (within 1 %) are sorted so that those of the
  // path named first come last; then by name. A later entry takes precedence where both have a valid post.
  explicit Catalogue(const std::vector<std::string>& paths);
  // Takes rasters that are inspected already: for tests and tools.
  explicit Catalogue(std::vector<RasterInfo> rasters);

  const std::vector<RasterInfo>& rasters() const { return rasters_; }
  const std::vector<CatalogueProblem>& problems() const { return problems_; }
  const std::vector<SideLayer>& side_layers() const { return side_layers_; }

  // Returns the index of the first raster of a raster's layer. Rasters of equal resolution (within 1 %) are one layer
  // if one path names them or their posts are on one grid; a layer ends where the next one begins.
  int layer_begin(int raster) const { return layer_begin_[static_cast<std::size_t>(raster)]; }
  // Returns true if all rasters are one layer, which then has no borders.
  bool one_layer() const { return rasters_.empty() || layer_begin_.back() == 0; }

  // Sets offsets, bands and resolved posts. Call it before any posts are used: not thread-safe.
  void join_layers(LayerJoins joins);
  const LayerJoins& joins() const { return joins_; }
  double offset_m(int raster) const {
    return joins_.offsets_m.empty() ? 0 : joins_.offsets_m[static_cast<std::size_t>(raster)];
  }
  double resolved_posts(int raster) const {
    return joins_.resolved_posts.empty() ? 1 : joins_.resolved_posts[static_cast<std::size_t>(raster)];
  }

  // Returns the index in rasters() of the file with this path.
  std::optional<SourceIndex> find(const std::string& path) const;

  // Returns indices into rasters() of files whose footprint touches the box, grown by margin_deg (negative: shrunk);
  // ascending (coarse to fine). west may be any longitude, east >= west; boxes of 360 degrees or more cover all
  // longitudes. Fast for 64 800 tiles (1-degree buckets).
  std::vector<int> touching(double south_deg, double north_deg, double west_deg, double east_deg,
                            double margin_deg = 0) const;

  // Returns a hash that changes whenever a file, its size or its modification time changes, and with the joins of
  // layers if there are several. It is part of every frame's content hash.
  std::uint64_t fingerprint() const { return fingerprint_; }

 private:
  void index(const std::vector<std::string>& paths);
  void find_layers(const std::vector<std::string>& paths);
  void find_fingerprint();
  std::vector<RasterInfo> rasters_;
  std::vector<CatalogueProblem> problems_;
  std::vector<SideLayer> side_layers_;
  std::vector<int> layer_begin_;
  LayerJoins joins_;
  std::uint64_t fingerprint_ = 0;
  std::vector<SourceIndex> by_path_;  // indices into rasters_, ascending by path
  // Indices of the rasters that touch each of 180 x 360 cells of one degree, row 0 at the south pole, column 0 at -180.
  std::vector<std::vector<int>> buckets_;
};

// Returns warnings for a client about files that a coarser layer replaces, and about files whose position on the Moon
// is unknown. The texts depend on the files only, not on this machine.
std::vector<std::string> warnings_about(const Catalogue& catalogue, std::span<const SourceIndex> replaced);

}  // namespace selenograph::dem
