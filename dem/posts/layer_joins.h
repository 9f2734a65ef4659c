// Joins of layers: offsets, given or fitted; and the steps at layer borders.
#pragma once

#include <cmath>
#include <cstddef>
#include <optional>
#include <string>
#include <vector>

#include "dem/catalogue/catalogue.h"

namespace selenograph::dem {

// A number that is said of the files whose name matches the pattern (as in a shell, with or without extension).
struct NamedNumber {
  std::string pattern;
  std::optional<double> value;  // empty: found from the files
};
struct NumberRange {
  const char* name;
  double low, high;
};
// Parses "PATTERN=NUMBER" or "PATTERN=fit". Throws std::invalid_argument that says what is wrong.
NamedNumber parse_named_number(const std::string& text, const NumberRange& range);
// The same of offsets added to heights, m.
NamedNumber parse_layer_offset(const std::string& text);

struct FittedOffset {
  int source;  // first file of a group, which has one offset
  double offset_m = 0;
  std::size_t posts = 0;  // border posts; 0: no border and no offset
};

// Sets the catalogue's joins. If several patterns match a file the last one applies. "fit" uses the median of the
// differences between the coarser layer and the file's posts along their border, layer by layer from the coarsest on.
// Throws DataError naming a pattern that matches no file, or an unreadable file.
std::vector<FittedOffset> join_layers(Catalogue& catalogue, double blend_posts,
                                      const std::vector<NamedNumber>& offsets);

// Heights of a layer's border posts minus those of the coarser layers, m.
struct Steps {
  double mean_m = 0, rms_m = 0, worst_m = 0;  // `worst_m`: the largest in size
};

struct LayerBorder {
  std::vector<int> sources;    // files of the group, ascending
  int beneath = -1;            // the file below most of the border
  std::size_t posts = 0;       // compared posts
  double offset_m = 0;         // offset of the first file
  double band_m = 0;           // outside the border, over which the coarser layers are bent; 0: they are not
  Steps in_files;              // without the offset
  Steps bent;                  // with it: by this the coarser layers are bent at the border
  double typical_error_m = 0;  // of the layer beneath, from its post spacing
  // Whether one layer is probably displaced against the other: --layer-offset is for this.
  bool is_displaced() const { return std::abs(bent.mean_m) > typical_error_m; }
};

// Measures the borders of at most `most` groups that overlap coarser layers, from coarse to fine. Groups without a
// border (that cover everything below them) are omitted. Throws as above.
std::vector<LayerBorder> measure_borders(const Catalogue& catalogue, std::size_t most);

}  // namespace selenograph::dem
