// Finding the files of a catalogue, and what each of them holds.
#pragma once

#include <chrono>
#include <cstddef>
#include <functional>
#include <string>
#include <string_view>
#include <vector>

#include "dem/files/raster_info.h"

namespace selenograph::dem {

// A file or folder that could not be used, and why. Reported by `info`, /v1/datasets and the log; never silent.
struct CatalogueProblem {
  std::string path;
  std::string what;
  bool located = false;    // its label is legible: it is among the rasters, and fails where its posts are needed
  bool unrelated = false;  // an image, or nothing says that it is a height map: answers don't suffer from its absence
};

// A file beside a DEM that says something about its heights, and holds none.
struct SideLayer {
  std::string path;
  std::string kind;  // "effective resolution" or "error of heights"
};
// Empty: the name is none of a side layer's. They are LOLA's: "..._effres.tif", "..._err.tif".
std::string side_layer_kind(std::string_view path);

struct CatalogueOptions {
  // What was found is kept in "catalogue/" there, and files that are still the same need not be read at the next
  // opening; empty: nothing is kept, and every file is read.
  std::string cache_dir{};
  // Told, each once, what the operator should know: why a saved catalogue could not be used or kept, and which files on
  // a network could not be reached. May be empty.
  std::function<void(const std::string&)> log{};
  // A second change within one step of the file system's clock leaves size and time as they are: what changed this
  // short a time before it was read is read again at the next opening.
  std::chrono::nanoseconds settling = std::chrono::seconds(2);
};

struct FoundFiles {
  std::vector<RasterInfo> rasters;  // each file once
  std::vector<CatalogueProblem> problems;
  std::vector<SideLayer> side_layers;
  std::size_t inspected = 0;  // that had to be read
};

// As Catalogue's constructor says; reads and checks on all cores, remote files on more threads than that. Keeps what it
// found for the next time.
FoundFiles find_files(const std::vector<std::string>& paths, const CatalogueOptions& options);

}  // namespace selenograph::dem
