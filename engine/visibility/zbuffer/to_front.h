// Moves the lanes of a float vector that a mask sets to the front, in their order. Kernels include this file once for
// each Highway target.
//
// The lanes move in registers: compressing into memory takes Zen 4 a hundred times as long. Short vectors use a table
// of our own: GCC would copy the table of Highway, a kilobyte, onto the stack for each vector.
#if defined(SELENOGRAPH_ENGINE_TO_FRONT) == defined(HWY_TARGET_TOGGLE)
#ifdef SELENOGRAPH_ENGINE_TO_FRONT
#undef SELENOGRAPH_ENGINE_TO_FRONT
#else
#define SELENOGRAPH_ENGINE_TO_FRONT
#endif

#include <hwy/highway.h>

#include <cstdint>

#ifndef SELENOGRAPH_ENGINE_SET_LANES
#define SELENOGRAPH_ENGINE_SET_LANES
namespace selenograph::engine {

// Permutation for each mask of eight lanes: set lanes first, then the others. Its first half serves vectors of four
// lanes.
struct alignas(64) SetLanesFirst {
  std::int32_t lane[256][8];
};
constexpr SetLanesFirst set_lanes_first() {
  SetLanesFirst out{};
  for (int mask = 0; mask < 256; ++mask) {
    int at = 0;
    for (const int is_set : {1, 0})
      for (int i = 0; i < 8; ++i)
        if ((mask >> i & 1) == is_set) out.lane[mask][at++] = i;
  }
  return out;
}
inline constexpr SetLanesFirst kSetLanesFirst = set_lanes_first();

}  // namespace selenograph::engine
#endif

HWY_BEFORE_NAMESPACE();
namespace selenograph::engine::HWY_NAMESPACE {

class ToFront {
  using F = hwy::HWY_NAMESPACE::CappedTag<float, 16>;
  using I = hwy::HWY_NAMESPACE::RebindToSigned<F>;
  using VF = hwy::HWY_NAMESPACE::Vec<F>;
  using VI = hwy::HWY_NAMESPACE::Vec<I>;
  using MF = hwy::HWY_NAMESPACE::Mask<F>;

 public:
  HWY_INLINE explicit ToFront(MF mask) : mask_(mask) {
    if constexpr (kByTable) {
      std::uint8_t bits[8] = {};
      hwy::HWY_NAMESPACE::StoreMaskBits(F(), mask, bits);
      lanes_ = hwy::HWY_NAMESPACE::LoadU(I(), kSetLanesFirst.lane[bits[0]]);
    }
  }
  HWY_INLINE VF operator()(VF values) const {
    if constexpr (kByTable)
      return hwy::HWY_NAMESPACE::TableLookupLanes(values, hwy::HWY_NAMESPACE::IndicesFromVec(F(), lanes_));
    else
      return hwy::HWY_NAMESPACE::Compress(values, mask_);
  }
  HWY_INLINE VI operator()(VI values) const {
    if constexpr (kByTable)
      return hwy::HWY_NAMESPACE::TableLookupLanes(values, hwy::HWY_NAMESPACE::IndicesFromVec(I(), lanes_));
    else
      return hwy::HWY_NAMESPACE::Compress(values, hwy::HWY_NAMESPACE::RebindMask(I(), mask_));
  }

 private:
  static constexpr bool kByTable = hwy::HWY_NAMESPACE::MaxLanes(F()) <= 8;
  MF mask_;
  VI lanes_;
};

}  // namespace selenograph::engine::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif
