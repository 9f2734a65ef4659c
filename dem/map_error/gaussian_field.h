// A stationary Gaussian random field on the sphere, as a function of position and seed.
//
//     o   o   o   o       White noise on a cubic lattice through space, weighted by a B-spline of degree 7 along each
//     o   o  x o   o      axis (de Boor 1978, A Practical Guide to Splines): 8 x 8 x 8 lattice points around the
//     o   o   o   o       position x. Each point's deviate is a hash of its indices and the seed.
//
// The sum is divided by the root of the sum of the squared weights, so that the variance is the same everywhere. The
// correlation at distance d is that of a B-spline of degree 15, within 0.008 of exp(-(d/L)^2), and depends on the
// position in the lattice by less than 0.004. A sphere in this space has neither poles nor borders. Deviates are sums
// of eight uniform ones: the field's kurtosis is below that of a normal one by at most 0.02.
#pragma once

#include <cstdint>

#include "dem/grid/geodesy.h"

namespace selenograph::dem {

// Thread-safe: const functions may be called concurrently, each with a cursor of its own.
class GaussianField {
 public:
  // Fields stay within this many standard deviations.
  static constexpr double kMaxDeviations = 6;

  GaussianField(double standard_deviation, double correlation_length_m, std::uint64_t seed);

  // Deviates around the latest position. Consecutive positions in one lattice cell share them.
  class Cursor {
   public:
    Cursor() = default;

   private:
    friend class GaussianField;
    bool valid_ = false;
    std::int64_t x_ = 0, y_ = 0, z_ = 0;  // the cell
    double deviates_[8][8][8];            // by z, y, x
  };

  struct Sample {
    double value;
    Vec3 gradient;  // per metre, in space
  };
  Sample at(const Vec3& position_m, Cursor& cursor) const;

  double standard_deviation() const { return standard_deviation_; }
  double correlation_length_m() const { return correlation_length_m_; }

 private:
  void draw(std::int64_t x, std::int64_t y, std::int64_t z, Cursor& cursor) const;

  double standard_deviation_, correlation_length_m_, step_m_;
  std::uint64_t seed_;
};

}  // namespace selenograph::dem
