// Interprets PDS3 labels of Kaguya and LOLA products: samples and georeferencing.
//
// GDAL's driver is not used: it ignores DUMMY, and mirrors tiles that carry the old positive sign of
// SAMPLE_PROJECTION_OFFSET. Keywords: Planetary Science Data Dictionary.
#pragma once

#include <string>

#include "dem/files/pds_label.h"
#include "dem/files/raw_image.h"

namespace selenograph::dem {

// Returns all properties that are needed to read the posts. Throws DataError naming the label when it contradicts
// itself, or is not about heights on the 1737.4 km sphere. Also when its projection or sample type is not supported, or
// when the data file is missing or shorter than the label says.
RawImage describe_pds_image(const PdsObject& label, const std::string& label_path);

}  // namespace selenograph::dem
