// Which vectors kernels are compiled for; before any of Highway's headers.
#pragma once

// Vectors without a size at compile time (SVE, RVV) can't be members of structures or of arrays, as they are here: such
// machines use NEON, or none.
#define HWY_DISABLED_TARGETS (HWY_SVE | HWY_SVE2 | HWY_SVE_256 | HWY_SVE2_128 | HWY_RVV)
