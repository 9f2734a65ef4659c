// Loops over lanes for every vector width that a machine may have, chosen at run time: Highway's foreach_target.h
// compiles a file once per width. Include this before any of Highway's headers.
//
// Most of these loops are plain C++ that the compiler vectorises for each width. No lane depends on another and nothing
// is contracted to fused multiply-add (-ffp-contract=off), so every width gives the same bits.
#pragma once

// Each set of vectors costs compilation. On x86-64 there are AVX-512, AVX2, and what the compiler assumes of every
// processor, with which frames take three times as long as with AVX2. The sets above AVX-512's first (AVX3_DL and
// better) add no arithmetic on float or double. Vectors without a size at compile time (SVE, RVV) cannot be members of
// structures or arrays, as the kernels need: such machines use NEON, or scalar code.
#define HWY_DISABLED_TARGETS \
  (HWY_SSE4 | HWY_SSSE3 | (HWY_AVX3 - 1) | HWY_SVE | HWY_SVE2 | HWY_SVE_256 | HWY_SVE2_128 | HWY_RVV)

// Precedes a loop over lanes whose iterations do not access each other's memory.
#if defined(__clang__)
#define SELENOGRAPH_INDEPENDENT_LANES _Pragma("clang loop vectorize(assume_safety)")
#elif defined(__GNUC__)
#define SELENOGRAPH_INDEPENDENT_LANES _Pragma("GCC ivdep")
#else
#define SELENOGRAPH_INDEPENDENT_LANES
#endif
