// Loops over the lanes of a packet, compiled for several vector widths and chosen at run time.
//
// No lane depends on another and nothing is contracted to fused multiply-add (-ffp-contract=off), so every clone gives
// the same bits.
#pragma once

#if defined(__x86_64__) && defined(__GNUC__) && !defined(__clang__) && !defined(__SANITIZE_ADDRESS__) && \
    !defined(__SANITIZE_THREAD__)
#define SELENOGRAPH_VECTORISED \
  __attribute__((target_clones("arch=x86-64-v4", "arch=x86-64-v3", "default"), optimize("O3")))
#else
#define SELENOGRAPH_VECTORISED
#endif

// Before a loop over lanes: its iterations don't touch each other's memory.
#if defined(__GNUC__) && !defined(__clang__)
#define SELENOGRAPH_INDEPENDENT_LANES _Pragma("GCC ivdep")
#else
#define SELENOGRAPH_INDEPENDENT_LANES
#endif
