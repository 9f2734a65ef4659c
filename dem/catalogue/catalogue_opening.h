// Finds and inspects the files of a catalogue.
#pragma once

#include <chrono>
#include <cstddef>
#include <functional>
#include <string>
#include <vector>

#include "dem/files/raster_info.h"

namespace selenograph::dem {

// A file or folder that could not be used, or not all of it, and the reason. Reported by `info`, /v1/datasets and the
// log; never silent.
struct CatalogueProblem {
  std::string path;
  std::string what;
  bool located = false;    // its label is valid: it is in the catalogue, and fails when its posts are needed
  bool unrelated = false;  // an image, or not known to be a height map: answers do not depend on it
};

// A raster of another quantity than heights, by its label, its band's description or its name (quantity.h).
struct SideLayer {
  std::string path;
  std::string kind;  // the quantity, e.g. "error of heights"
};

struct CatalogueOptions {
  // Results are saved in "catalogue/" in this folder, and unchanged files need not be read at the next opening; empty:
  // nothing is saved, and every file is read.
  std::string cache_dir{};
  // Receives messages for the operator, each once: why a saved catalogue could not be used or written, and which remote
  // files could not be reached. May be empty.
  std::function<void(const std::string&)> log{};
  // A second change within one clock step of the file system changes neither size nor time: a file that changed this
  // short a time before it was read is read again at the next opening.
  std::chrono::nanoseconds settling = std::chrono::seconds(2);
};

struct FoundFiles {
  std::vector<RasterInfo> rasters;  // each file once
  std::vector<CatalogueProblem> problems;
  std::vector<SideLayer> side_layers;
  std::size_t inspected = 0;  // number of files that had to be read
};

// See Catalogue's constructor. Reads and checks on all cores, remote files on more threads. Saves the results for the
// next opening.
FoundFiles find_files(const std::vector<std::string>& paths, const CatalogueOptions& options);

}  // namespace selenograph::dem
