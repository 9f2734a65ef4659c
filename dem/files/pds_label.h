// PDS3 labels: what a Kaguya or LOLA product says about its pixels and where they lie.
//
// The georeferencing of PDS3 products comes from here and not from GDAL, whose driver ignores DUMMY and mirrors tiles
// that carry the old positive sign of SAMPLE_PROJECTION_OFFSET. Keywords: PDS Standards Reference 3.8 (2009), chapter
// 12 (ODL) and the Planetary Science Data Dictionary.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "dem/grid/post_grid.h"

namespace selenograph::dem {

// The right-hand side of `KEYWORD = ...`. Quotes are taken off; a sequence or set has several items.
struct PdsValue {
  std::vector<std::string> items;
  std::string unit;  // the text between < and >, of the last item that has one

  std::string text() const;                               // the first item, or ""
  std::optional<double> number(std::size_t i = 0) const;  // nothing for N/A and other words; 16#...# is understood
};

// OBJECT or GROUP, and the label itself. Keywords and names are compared without regard to case.
struct PdsObject {
  std::string name;
  std::vector<std::pair<std::string, PdsValue>> values;
  std::vector<PdsObject> objects;

  const PdsValue* find(std::string_view keyword) const;              // in this object only
  const PdsValue* find_deep(std::string_view keyword) const;         // here, else in the first inner object that has it
  const PdsObject* find_object(std::string_view object_name) const;  // depth first
};

// Both throw DataError naming `path` and, for bad syntax, the line. Anything without PDS_VERSION_ID is not a label.
// Reading stops at END, so that the pixels behind an attached label are never looked at.
PdsObject parse_pds_label(std::string_view text, const std::string& path);
PdsObject read_pds_label(const std::string& path);

// Whether the file begins with a PDS3 label (a detached label, or an image with an attached one).
bool begins_with_pds_label(const std::string& path);
// Whether it is about a map: an IMAGE and an IMAGE_MAP_PROJECTION.
bool describes_map(const PdsObject& label);

struct PdsSample {
  int bytes = 2;
  bool real = false, has_sign = true, little_endian = false;
};

struct PdsImage {
  std::string data_path;         // the label itself when it is attached
  std::uint64_t first_byte = 0;  // of the first sample
  std::uint64_t row_bytes = 0;   // from one row's first sample to the next row's
  int width = 0, height = 0;
  PdsSample sample;
  // metres = (sample * scale + offset) * unit_m
  double scale = 1, offset = 0, unit_m = 1;
  std::vector<double> voids;  // sample values that are no heights
  std::string format;         // "PDS3 Kaguya", "PDS3 LOLA" or "PDS3"
  PostGrid grid;
};

// Everything needed to read the posts. Throws DataError naming the label when it contradicts itself, is not about
// heights on the 1737.4 km sphere or uses a projection or sample type that isn't supported, and when the data file is
// missing or shorter than the label says.
PdsImage describe_pds_image(const PdsObject& label, const std::string& label_path);

}  // namespace selenograph::dem
