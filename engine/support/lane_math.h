// Mathematical functions for loops over lanes that the compiler vectorises: plain arithmetic without calls or branches,
// with the same bits for every vector width.
#pragma once

#include <bit>
#include <cmath>
#include <cstdint>

namespace selenograph::engine {

#define SELENOGRAPH_LANE [[gnu::always_inline]] inline

// The standard library's functions, for single lanes.
struct ScalarMath {
  static double exp(double x) { return std::exp(x); }
  static double log(double x) { return std::log(x); }
  static double acos(double x) { return std::acos(x); }
};

struct LaneMath {
  // Returns e^x as 2^k e^r with |r| <= ln 2 / 2, by the series of e^r. Relative error 4e-16, absolute 1e-307. Arguments
  // from -infinity to 700.
  SELENOGRAPH_LANE static double exp(double x) {
    constexpr double kLn2High = 0x1.62e42fefap-1, kLn2Low = 0x1.cf79abc9e3b39803p-40, kRound = 0x1.8p52;
    const double clamped = x > -708 ? x : -708;
    const double shifted = clamped * 1.4426950408889634 + kRound;
    const double k = shifted - kRound;
    const double r = (clamped - k * kLn2High) - k * kLn2Low;
    double sum = 1.0 / 6227020800;
    sum = sum * r + 1.0 / 479001600;
    sum = sum * r + 1.0 / 39916800;
    sum = sum * r + 1.0 / 3628800;
    sum = sum * r + 1.0 / 362880;
    sum = sum * r + 1.0 / 40320;
    sum = sum * r + 1.0 / 5040;
    sum = sum * r + 1.0 / 720;
    sum = sum * r + 1.0 / 120;
    sum = sum * r + 1.0 / 24;
    sum = sum * r + 1.0 / 6;
    sum = sum * r + 0.5;
    sum = (sum * r + 1) * r + 1;
    // Adding kRound has moved k into the low bits.
    const auto power = (std::bit_cast<std::uint64_t>(shifted) + 1023) << 52;
    return sum * std::bit_cast<double>(power);
  }

  // Returns the logarithm of a normal positive number as exponent ln 2 + 2 atanh s, s = (m - 1) / (m + 1), by the
  // series of atanh. Error 1e-15.
  SELENOGRAPH_LANE static double log(double x) {
    constexpr std::uint64_t kMantissa = (std::uint64_t{1} << 52) - 1;
    constexpr std::uint64_t kHalfRoot = std::bit_cast<std::uint64_t>(0x1.6a09e667f3bcdp-1);
    const auto bits = std::bit_cast<std::uint64_t>(x);
    // Split x so that the mantissa m lies between sqrt(1/2) and sqrt(2).
    const std::uint64_t from = bits - kHalfRoot + (std::uint64_t{1023} << 52);
    const double exponent = std::bit_cast<double>((from >> 52) | std::bit_cast<std::uint64_t>(0x1p52)) - 0x1p52 - 1023;
    const double m = std::bit_cast<double>((from & kMantissa) + kHalfRoot);
    const double s = (m - 1) / (m + 1), q = s * s;
    double sum = 1.0 / 19;
    sum = sum * q + 1.0 / 17;
    sum = sum * q + 1.0 / 15;
    sum = sum * q + 1.0 / 13;
    sum = sum * q + 1.0 / 11;
    sum = sum * q + 1.0 / 9;
    sum = sum * q + 1.0 / 7;
    sum = sum * q + 1.0 / 5;
    sum = sum * q + 1.0 / 3;
    return exponent * 0.6931471805599453 + 2 * s * (1 + sum * q);
  }

  // Returns the arccosine for -1 <= x <= 1, with an error of 2.1e-8 rad (Abramowitz & Stegun 4.4.46).
  SELENOGRAPH_LANE static double acos(double x) {
    const double a = x < 0 ? -x : x;
    double sum = -0.0012624911;
    sum = sum * a + 0.0066700901;
    sum = sum * a - 0.0170881256;
    sum = sum * a + 0.0308918810;
    sum = sum * a - 0.0501743046;
    sum = sum * a + 0.0889789874;
    sum = sum * a - 0.2145988016;
    sum = sum * a + 1.5707963050;
    const double angle = std::sqrt(1 - a) * sum;
    return x < 0 ? 3.141592653589793 - angle : angle;
  }
};

}  // namespace selenograph::engine
