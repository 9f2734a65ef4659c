// Which DEM files there are and where they lie: a lookup, not open files.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "dem/block.h"
#include "dem/raster_info.h"

namespace selenograph::dem {

// A file or folder that could not be used, and why. Reported by `info`, /v1/datasets and the log; never silent.
struct CatalogueProblem {
  std::string path;
  std::string what;
  bool located = false;    // its label is legible: it is among the rasters, and fails where its posts are needed
  bool unrelated = false;  // nothing says that it is a height map at all: answers don't suffer from its absence
};

class Catalogue {
 public:
  // `paths` are files or folders (searched recursively). Label and data of one PDS product are one entry. A file named
  // explicitly that can't be used throws DataError; one found in a folder becomes a problem. Entries are sorted from
  // coarse to fine, then by name: a later entry wins over an earlier one where both have a valid post.
  explicit Catalogue(const std::vector<std::string>& paths);
  // For tests and callers who know their files.
  explicit Catalogue(std::vector<RasterInfo> rasters);

  const std::vector<RasterInfo>& rasters() const { return rasters_; }
  const std::vector<CatalogueProblem>& problems() const { return problems_; }

  // The index in rasters() of the file of that path.
  std::optional<SourceIndex> find(const std::string& path) const;

  // Indices into rasters() of those whose footprint touches the box, grown by margin_deg (below 0: shrunk); ascending
  // (coarse to fine). west may be anything, east >= west; boxes of 360 degrees and more mean all longitudes. Fast for
  // 64 800 tiles (a 1-degree bucket grid).
  std::vector<int> touching(double south_deg, double north_deg, double west_deg, double east_deg,
                            double margin_deg = 0) const;

  // Changes whenever a file, its size or its time changes. Part of every frame's content hash.
  std::uint64_t fingerprint() const;

 private:
  void index();
  std::vector<RasterInfo> rasters_;
  std::vector<CatalogueProblem> problems_;
  std::vector<SourceIndex> by_path_;       // ascending by path
  std::vector<std::vector<int>> buckets_;  // 180 x 360 cells of one degree, row 0 at the south pole, column 0 at -180
};

}  // namespace selenograph::dem
