// What joins layers, from what is asked for: offsets, given or fitted; and how large the steps between layers are.
#pragma once

#include <cstddef>
#include <optional>
#include <string>
#include <vector>

#include "dem/catalogue/catalogue.h"

namespace selenograph::dem {

// Added to the heights of the files whose name the pattern matches (as in a shell, with extension or without).
struct LayerOffset {
  std::string pattern;
  std::optional<double> metres;  // nothing: fitted
};
// "PATTERN=METRES" or "PATTERN=fit". Throws std::invalid_argument that says what is wrong.
LayerOffset parse_layer_offset(const std::string& text);

struct FittedOffset {
  int source;  // the first file of those that touch each other on one grid: they have one offset
  double offset_m = 0;
  std::size_t posts = 0;  // along the border; 0: there is none, and no offset
};

// Sets the catalogue's joins. Of several patterns that match a file the last one counts. "fit" takes the median of the
// differences between the layer beneath and the file's posts along their border, layer by layer from the coarsest on.
// Throws DataError naming a pattern that matches no file, or a file that can't be read.
std::vector<FittedOffset> join_layers(Catalogue& catalogue, double blend_posts,
                                      const std::vector<LayerOffset>& offsets);

// Heights on the finer side of a border less those of what lies beneath, m.
struct Steps {
  double mean_m = 0, rms_m = 0, worst_m = 0;  // `worst_m`: the largest in size
};

struct LayerBorder {
  std::vector<int> sources;  // files that touch each other on one grid, ascending
  int beneath = -1;          // the file that most of the border lies over
  std::size_t posts = 0;     // that were compared
  double offset_m = 0;       // of the first file
  double band_m = 0;         // 0: it isn't blended
  Steps before, after;       // as the files have them; with offset and blending
};

// Of the first `most` layers' pieces that lie over coarser ones, from coarse to fine. A piece without a border (a layer
// that covers all that is beneath it) is left out. Throws as above.
std::vector<LayerBorder> measure_borders(const Catalogue& catalogue, std::size_t most);

}  // namespace selenograph::dem
