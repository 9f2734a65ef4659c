#include "dem/detail/crater_shape.h"

#include <algorithm>
#include <cmath>

#include "dem/base/noise.h"

namespace selenograph::dem {
namespace {

constexpr int kAges = 48;
constexpr double kStep = 1.0 / CraterShape::kStepsPerRadius;
// Lattice on which the equation is solved, in crater radii: annuli of this width, out to where the height stays 0.
constexpr double kBorder = 14, kAnnulus = 0.01;

// Returns the height of a fresh crater, in diameters, at r crater radii (Fassett & Thomson 2014, eq. 4).
double fresh(double r) {
  if (r < 0.98) return -0.228809953 + r * (0.227533882 + r * (0.083116795 - r * 0.039499407));
  if (r <= 1.02) return 0.036822095;
  if (r <= 1.5) return 0.188253307 + r * (-0.187050452 + r * (0.01844746 + r * 0.01505647));
  return 0;
}

// Solves the diffusion equation on annuli: finite volumes, backward Euler, no flow through the centre and the border.
class Diffusion {
 public:
  Diffusion() : heights(static_cast<std::size_t>(kBorder / kAnnulus)) {
    for (std::size_t i = 0; i < heights.size(); ++i) heights[i] = fresh((static_cast<double>(i) + 0.5) * kAnnulus);
  }

  // Advances by `age` in equal steps, so that one factorisation of the tridiagonal matrix serves all steps.
  void advance(double age, int steps) {
    const std::size_t n = heights.size();
    // Eliminate along the annuli (Thomas algorithm): `own` is the inverse pivot, `inward` and `outward` are the
    // normalised couplings to the neighbours, `right` is the right side after elimination.
    std::vector<double> outward(n), inward(n), own(n), right(n);
    for (std::size_t i = 0; i < n; ++i) {
      const double middle = static_cast<double>(i) + 0.5, scale = age / steps / (kAnnulus * kAnnulus * middle);
      const double in = i == 0 ? 0 : scale * static_cast<double>(i),
                   out = i + 1 == n ? 0 : scale * static_cast<double>(i + 1);
      own[i] = 1 / (1 + in + out - (i == 0 ? 0 : in * outward[i - 1]));
      inward[i] = own[i] * in;
      outward[i] = own[i] * out;
    }
    for (int step = 0; step < steps; ++step) {
      // Substitute forward, then backward.
      double inner = 0;
      for (std::size_t i = 0; i < n; ++i) {
        inner = own[i] * heights[i] + inward[i] * inner;
        right[i] = inner;
      }
      double outer = 0;
      for (std::size_t i = n; i-- > 0;) {
        outer = right[i] + outward[i] * outer;
        heights[i] = outer;
      }
    }
  }

  std::vector<double> heights;
};

// Interpolates heights at the annuli's middles at r crater radii.
double height_at(const std::vector<double>& annuli, double r) {
  const double index = std::max(0.0, r / kAnnulus - 0.5);
  const auto i = std::min(static_cast<std::size_t>(index), annuli.size() - 2);
  const double f = std::min(1.0, index - static_cast<double>(i));
  return annuli[i] + f * (annuli[i + 1] - annuli[i]);
}

// Returns the age of a row of the table. Rows are equally spaced in the square root of the age, by which shapes widen.
double age_of_row(int row) {
  const double root = std::sqrt(CraterShape::kOldest) * row / (kAges - 1);
  return root * root;
}

// Largest amplitudes of waves of 2 to 5 periods along each of two axes, in crater radii.
constexpr std::array<double, CraterOutline::kWaves> kAmplitudes{0.066, 0.046, 0.03, 0.02};

// Returns the factor of all amplitudes: 1 up to 3 m, 0.5 at 100 m, 0.3 at 1 km.
double unevenness(double diameter_m) {
  constexpr double kUneven_m = 3, kExponent = -0.2;
  return diameter_m <= kUneven_m ? 1 : std::pow(diameter_m / kUneven_m, kExponent);
}

}  // namespace

// Samples a profile at the table's steps, and measures its depth. `scale`: factor of the heights.
CraterShape::Row CraterShape::row_of(const std::vector<double>& annuli, double age, double scale) const {
  Row row;
  const double end = reach(age), fade_begin = std::max(1.5, end * 2 / 3);
  double highest = 0, r = 0;
  while (r < end) {
    // Fade the height to 0 towards the reach, where the diffused profile would go on.
    const double h = scale * height_at(annuli, r) * smoothstep((end - r) / (end - fade_begin));
    row.heights.push_back(static_cast<float>(h));
    highest = std::max(highest, h);
    r += kStep;
  }
  // Give all rows one length: profiles of different ages are interpolated.
  row.heights.resize(static_cast<std::size_t>(reach(kOldest) / kStep) + 3);
  row.depth = highest - static_cast<double>(row.heights[0]);
  return row;
}

// Ages the fresh shape step by step, samples a row of the table after each step, and measures the bounds of all rows.
CraterShape::CraterShape() {
  Diffusion ageing;
  constexpr int kSteps = 24;  // from row to row
  ageing.advance(kRounding, kSteps);
  const double scale = kFreshDepth / row_of(ageing.heights, 0, 1).depth;
  for (int i = 0; i < kAges; ++i) {
    if (i > 0) ageing.advance(age_of_row(i) - age_of_row(i - 1), kSteps);
    rows_.push_back(row_of(ageing.heights, age_of_row(i), scale));
  }
  // Craters that replace each other converge to height / replaced: h = h (1 - replaced) + height.
  for (int i = 0; i < kAges; ++i)
    for (double r = 0; r + kStep < reach(age_of_row(i)); r += kStep) {
      const double h = height(r, age_of_row(i)) / replaced_at(r, age_of_row(i));
      deepest_ = std::max(deepest_, -h);
      highest_ = std::max(highest_, h);
    }
}

const CraterShape& CraterShape::of_all() {
  static const CraterShape shape;
  return shape;
}

CraterShape::RowPair CraterShape::rows_at(double age) const {
  const double root = std::sqrt(std::clamp(age / kOldest, 0.0, 1.0)) * (kAges - 1);
  const int row = std::min(static_cast<int>(root), kAges - 2);
  return {rows_[static_cast<std::size_t>(row)], rows_[static_cast<std::size_t>(row) + 1], root - row};
}

CraterShape::Profile CraterShape::profile(double age) const {
  const RowPair rows = rows_at(age);
  return {rows.younger.heights.data(), rows.older.heights.data(), rows.share};
}

// Interpolates bilinearly in the table, by age and by distance.
double CraterShape::height(double r, double age) const {
  const RowPair rows = rows_at(age);
  const double step = r * kStepsPerRadius;
  const std::vector<float>&a = rows.younger.heights, &b = rows.older.heights;
  const auto i = static_cast<std::size_t>(step);
  if (i + 1 >= a.size()) return 0;
  const double f = step - static_cast<double>(i);
  const auto along = [&](const std::vector<float>& h) {
    const double low = static_cast<double>(h[i]);
    return low + f * (static_cast<double>(h[i + 1]) - low);
  };
  return (1 - rows.share) * along(a) + rows.share * along(b);
}

double CraterShape::age_of(double depth_left) const {
  const double depth = depth_left * rows_[0].depth;
  std::size_t i = 0;
  while (i + 2 < rows_.size() && rows_[i + 1].depth > depth) ++i;
  // Interpolate linearly between the rows: this is the inverse of depth_left().
  const double f = std::clamp((rows_[i].depth - depth) / (rows_[i].depth - rows_[i + 1].depth), 0.0, 1.0);
  const double root = std::sqrt(kOldest) * (static_cast<double>(i) + f) / (kAges - 1);
  return root * root;
}

double CraterShape::depth_left(double age) const {
  const RowPair rows = rows_at(age);
  return ((1 - rows.share) * rows.younger.depth + rows.share * rows.older.depth) / rows_[0].depth;
}

CraterOutline::CraterOutline(std::uint64_t crater_id, double diameter_m, double age) {
  constexpr std::uint64_t kOutlines = 0x6f75746c696e6573;  // makes these numbers differ from the crater's others
  // Cut a hash into four deviates of 16 bits, uniform in (-1, 1).
  const std::uint64_t seed = crater_id ^ kOutlines;
  const std::uint64_t along_cosine = split_mix(seed + kSplitMixStep), along_sine = split_mix(seed + 2 * kSplitMixStep);
  const auto deviate = [](std::uint64_t bits, std::size_t n) {
    return (static_cast<double>(bits >> (16 * n) & 0xffff) + 0.5) / 32768 - 1;
  };
  const double uneven = unevenness(diameter_m), faded = std::exp(-age);
  for (std::size_t n = 0; n < kWaves; ++n) {
    const auto periods = static_cast<int>(n) + 2;
    double left = uneven * kAmplitudes[n];
    for (int i = 0; i < periods * periods; ++i) left *= faded;
    cosine_[n] = static_cast<float>(left * deviate(along_cosine, n));
    sine_[n] = static_cast<float>(left * deviate(along_sine, n));
  }
}

}  // namespace selenograph::dem
