// Offsets of layers, given or fitted, and the steps at layer borders.
//
//     finer layer      o---o---o                  step_m = finer post - coarser layers, at each post of the border
//                              |  step_m          offset_m = value added to the finer layer's heights;
//     coarser layers  - - - - -+- - - - - -       "fit": minus the median step of the files as they are
#pragma once

#include <cmath>
#include <cstddef>
#include <optional>
#include <string>
#include <vector>

#include "dem/catalogue/catalogue.h"

namespace selenograph::dem {

// Number for all files whose name matches the pattern (as in a shell, with or without extension).
struct NamedNumber {
  std::string pattern;
  std::optional<double> value;  // empty: measured from the files ("fit")
};
struct NumberRange {
  const char* name;
  double low, high;
};
// Parses "PATTERN=NUMBER" or "PATTERN=fit". Throws std::invalid_argument that describes the error.
NamedNumber parse_named_number(const std::string& text, const NumberRange& range);
// Parses an offset to be added to heights, m.
NamedNumber parse_layer_offset(const std::string& text);

struct FittedOffset {
  int source;  // first file of the group that shares the offset
  double offset_m = 0;
  std::size_t posts = 0;  // number of border posts; 0: no border, offset 0
};

// Sets the catalogue's joins. If several patterns match a file the last one applies. "fit" uses the median of the
// differences between the coarser layer and the file's posts along their border, layer by layer from the coarsest on.
// Throws DataError naming a pattern that matches no file, or an unreadable file.
std::vector<FittedOffset> join_layers(Catalogue& catalogue, double blend_posts,
                                      const std::vector<NamedNumber>& offsets);

// Statistics of the steps at a border: heights of a layer's border posts minus those of the coarser layers, m.
struct Steps {
  double mean_m = 0, rms_m = 0, worst_m = 0;  // worst_m: the step largest in absolute value, with its sign
};

// Measured border of one group of files.
struct LayerBorder {
  std::vector<int> sources;    // files of the group, ascending
  int beneath = -1;            // file below the largest number of border posts
  std::size_t posts = 0;       // number of compared posts
  double offset_m = 0;         // offset of the group's first file
  double band_m = 0;           // width of the band in which the coarser layers are bent; 0: they are not
  Steps in_files;              // steps without the offset
  Steps bent;                  // steps with the offset: the coarser layers are bent by these at the border
  double typical_error_m = 0;  // typical error of the layer beneath, from its post spacing
  // Returns true if one layer is probably displaced against the other, which --layer-offset can correct.
  bool is_displaced() const { return std::abs(bent.mean_m) > typical_error_m; }
};

// Measures the borders of at most `max_groups` groups that overlap coarser layers, from coarse to fine. Groups that
// cover everything below them have no border and are omitted. Throws as join_layers() does.
std::vector<LayerBorder> measure_borders(const Catalogue& catalogue, std::size_t max_groups);

}  // namespace selenograph::dem
