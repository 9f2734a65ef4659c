// Arctangents of lanes, without fused operations: every vector width gives the same bits. For files that Highway
// compiles once per width (dem/base/vector_targets.h): include it after hwy/highway.h, outside of any namespace.
#if defined(SELENOGRAPH_ENGINE_SUPPORT_LANE_ANGLES_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef SELENOGRAPH_ENGINE_SUPPORT_LANE_ANGLES_H_
#undef SELENOGRAPH_ENGINE_SUPPORT_LANE_ANGLES_H_
#else
#define SELENOGRAPH_ENGINE_SUPPORT_LANE_ANGLES_H_
#endif

#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace selenograph::engine::HWY_NAMESPACE {

// Returns the arctangent, rad, with an error of 2e-7 (the polynomial of Cephes' atanf, S. Moshier).
template <class D, class V>
HWY_INLINE V Arctangent(D d, V x) {
  namespace hn = hwy::HWY_NAMESPACE;
  const V size = hn::Abs(x), unity = hn::Set(d, 1.F);
  const auto is_steep = hn::Gt(size, hn::Set(d, 2.414213562F)), is_middle = hn::Gt(size, hn::Set(d, 0.4142135624F));
  const V numerator = hn::IfThenElse(is_steep, hn::Set(d, -1.F), hn::IfThenElse(is_middle, hn::Sub(size, unity), size));
  const V denominator = hn::IfThenElse(is_steep, size, hn::IfThenElse(is_middle, hn::Add(size, unity), unity));
  const V offset = hn::IfThenElse(is_steep, hn::Set(d, 1.5707963268F),
                                  hn::IfThenElse(is_middle, hn::Set(d, 0.7853981634F), hn::Zero(d)));
  const V t = hn::Div(numerator, denominator), square = hn::Mul(t, t);
  V sum = hn::Sub(hn::Mul(hn::Set(d, 8.05374449538e-2F), square), hn::Set(d, 1.38776856032e-1F));
  sum = hn::Add(hn::Mul(sum, square), hn::Set(d, 1.99777106478e-1F));
  sum = hn::Sub(hn::Mul(sum, square), hn::Set(d, 3.33329491539e-1F));
  const V angle = hn::Add(offset, hn::Add(hn::Mul(hn::Mul(sum, square), t), t));
  return hn::CopySign(angle, x);
}

// Returns the angle of (x, y) from the x axis, in [0, 2 pi], rad.
template <class D, class V>
HWY_INLINE V AngleOf(D d, V x, V y) {
  namespace hn = hwy::HWY_NAMESPACE;
  const V zero = hn::Zero(d), ax = hn::Abs(x), ay = hn::Abs(y);
  const auto is_high = hn::Gt(ay, ax);
  const V larger = hn::IfThenElse(is_high, ay, ax), smaller = hn::IfThenElse(is_high, ax, ay);
  const V ratio = hn::Div(smaller, hn::Max(larger, hn::Set(d, 1e-30F)));
  const V within = Arctangent(d, ratio);
  const V quarter = hn::IfThenElse(is_high, hn::Sub(hn::Set(d, 1.5707963268F), within), within);
  const V half = hn::IfThenElse(hn::Lt(x, zero), hn::Sub(hn::Set(d, 3.1415926536F), quarter), quarter);
  return hn::IfThenElse(hn::Lt(y, zero), hn::Sub(hn::Set(d, 6.2831853072F), half), half);
}

}  // namespace selenograph::engine::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif
