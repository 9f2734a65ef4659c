#include "engine/verify/difference_statistics.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>

namespace selenograph::engine {
namespace {

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();

// Returns the side of the squares. A square should be larger than the correlation length of differences, which is
// mostly that of craters. A large window affords larger squares: it keeps a thousand of them.
int square_side(const PostWindow& w) { return std::max(32, std::max(w.width, w.height) / 32); }

// RMS error of a radius rounded to double, whose steps are 2^-32 m at this size (uniform distribution). Its sign
// depends on the region, so that it does not average out over any number of posts.
constexpr double kRounding_m = 0x1p-32 * 0.28867513459481287;
constexpr double kSlopeStep_deg = 5;

// Sums over squares of a window. Posts must be added in the order of the window: only one row of squares is open.
class Group {
 public:
  explicit Group(const PostWindow& window)
      : side_(square_side(window)), open_(static_cast<std::size_t>((window.width + side_ - 1) / side_)) {}

  void add(int row, int col, double value) {
    if (row / side_ != row_of_squares_) close(row / side_);
    Sum& square = open_[static_cast<std::size_t>(col / side_)];
    square.count += 1;
    square.sum += value;
    absolute_ += std::abs(value);
    squares_ += value * value;
  }

  // Closes the last row of squares and returns the statistics.
  GroupStatistics finish() {
    close(-1);
    double count = 0, sum = 0;
    for (const Sum& s : closed_) {
      count += s.count;
      sum += s.sum;
    }
    GroupStatistics g{static_cast<std::size_t>(count), kNan, kNan, kNan, kNan, kNan};
    if (count == 0) return g;
    g.mean_m = sum / count;
    g.mean_absolute_m = absolute_ / count;
    g.rms_m = std::sqrt(squares_ / count);
    const auto k = static_cast<double>(closed_.size());
    if (k < 2) return g;
    double scatter = 0;
    for (const Sum& s : closed_) {
      const double off = s.sum - s.count * g.mean_m;
      scatter += off * off;
    }
    // Variance of a ratio estimator over clusters (Cochran 1977, eq. 2.46).
    g.standard_error_m = std::hypot(std::sqrt(scatter * k / (k - 1)) / count, kRounding_m);
    g.z = g.mean_m / g.standard_error_m;
    return g;
  }

 private:
  struct Sum {
    double count = 0, sum = 0;
  };
  // Moves the open row's squares to the closed ones and opens row `next`.
  void close(int next) {
    for (Sum& s : open_) {
      if (s.count > 0) closed_.push_back(s);
      s = {};
    }
    row_of_squares_ = next;
  }

  int side_, row_of_squares_ = -1;
  std::vector<Sum> open_, closed_;
  double absolute_ = 0, squares_ = 0;
};

// Returns the slope at a post, degrees, from its neighbours' heights; empty at the window's border and next to voids.
std::optional<double> slope_at(const RoundTrip& trip, int row, int col, double north_m, double east_m) {
  const PostWindow& w = trip.window;
  if (row == 0 || col == 0 || row == w.height - 1 || col == w.width - 1) return std::nullopt;
  const auto height = [&](int r, int c) { return static_cast<double>(trip.original_m[w.index(r, c)]); };
  const double slope = std::hypot((height(row - 1, col) - height(row + 1, col)) / (2 * north_m),
                                  (height(row, col + 1) - height(row, col - 1)) / (2 * east_m));
  if (std::isnan(slope)) return std::nullopt;
  return std::atan(slope) * kDegreesPerRadian;
}

// Interpolates between order statistics; NaN without values.
double percentile(const std::vector<float>& sorted, double percent) {
  if (sorted.empty()) return kNan;
  const double at = percent / 100 * static_cast<double>(sorted.size() - 1);
  const auto below = static_cast<std::size_t>(at);
  const auto low = static_cast<double>(sorted[below]),
             high = static_cast<double>(sorted[std::min(below + 1, sorted.size() - 1)]);
  return low + (at - static_cast<double>(below)) * (high - low);
}

// Rounds up to 1, 2, 3 or 5 times a power of ten. Returns a nanometre for zero.
double rounded_up(double x) {
  if (!(x > 0)) return 1e-9;
  const double power = std::pow(10.0, std::floor(std::log10(x)));
  for (const double digit : {1.0, 2.0, 3.0, 5.0})
    if (digit * power >= x * (1 - 1e-9)) return digit * power;
  return 10 * power;
}

// Computes the percentiles of the differences and of their absolute values, and the histogram's range.
void add_percentiles(const RoundTrip& trip, DifferenceStatistics& out) {
  std::vector<float> values;
  values.reserve(trip.compared);
  for (const float d : trip.difference_m)
    if (!std::isnan(d)) values.push_back(d);
  std::sort(values.begin(), values.end());
  out.median_m = percentile(values, 50);
  for (const double p : {0.1, 1.0, 5.0, 50.0, 95.0, 99.0, 99.9}) out.percentiles.push_back({p, percentile(values, p)});
  for (float& v : values) v = std::abs(v);
  std::sort(values.begin(), values.end());
  out.median_absolute_m = percentile(values, 50);
  for (const double p : {50.0, 95.0, 99.0, 99.9}) out.absolute_percentiles.push_back({p, percentile(values, p)});
  out.histogram.reach_m = rounded_up(percentile(values, 99.5));
}

// Calls visit(row, col, difference) for all posts that were compared.
template <typename Visit>
void each_difference(const RoundTrip& trip, Visit&& visit) {
  const PostWindow& w = trip.window;
  for (int r = 0; r < w.height; ++r)
    for (int c = 0; c < w.width; ++c)
      if (const float d = trip.difference_m[w.index(r, c)]; !std::isnan(d)) visit(r, c, static_cast<double>(d));
}

void add_histogram(const RoundTrip& trip, Histogram& out) {
  const double width_m = 2 * out.reach_m / static_cast<double>(out.counts.size());
  each_difference(trip, [&](int, int, double d) {
    if (d < -out.reach_m)
      ++out.below;
    else if (d > out.reach_m)
      ++out.above;
    else
      ++out.counts[std::min(static_cast<std::size_t>((d + out.reach_m) / width_m), out.counts.size() - 1)];
  });
}

// Groups the differences by quadrant of the window.
void add_quadrants(const RoundTrip& trip, DifferenceStatistics& out) {
  constexpr std::string_view kNames[] = {"NW", "NE", "SW", "SE"};
  const PostWindow& w = trip.window;
  std::vector<Group> groups(4, Group(w));
  each_difference(trip, [&](int r, int c, double d) {
    groups[static_cast<std::size_t>(2 * (r >= w.height / 2) + (c >= w.width / 2))].add(r, c, d);
  });
  for (std::size_t i = 0; i < 4; ++i) out.quadrants[i] = {kNames[i], groups[i].finish()};
}

// Groups the differences by the slope of the tile.
void add_slopes(const RoundTrip& trip, DifferenceStatistics& out) {
  const PostWindow& w = trip.window;
  std::vector<Group> groups(static_cast<std::size_t>(90 / kSlopeStep_deg) + 1, Group(w));
  const double north_m = kMetresPerDegree * w.lat_step_deg(), along_equator_m = kMetresPerDegree * w.lon_step_deg();
  each_difference(trip, [&](int r, int c, double d) {
    const double east_m = along_equator_m * std::cos(w.place(r, 0).lat_deg * kRadiansPerDegree);
    if (const auto slope = slope_at(trip, r, c, north_m, east_m))
      groups[static_cast<std::size_t>(*slope / kSlopeStep_deg)].add(r, c, d);
  });
  for (std::size_t i = 0; i < groups.size(); ++i) {
    const GroupStatistics g = groups[i].finish();
    const double from = static_cast<double>(i) * kSlopeStep_deg;
    if (g.posts > 0) out.slopes.push_back({from, from + kSlopeStep_deg, g});
  }
}

}  // namespace

DifferenceStatistics statistics_of(const RoundTrip& trip) {
  DifferenceStatistics out;
  Group window_group(trip.window);
  out.worst_m = kNan;
  each_difference(trip, [&](int r, int c, double d) {
    window_group.add(r, c, d);
    if (std::abs(d) <= std::abs(out.worst_m)) return;
    out.worst_m = d;
    out.worst_row = r;
    out.worst_col = c;
  });
  out.all = window_group.finish();
  double around_mean = 0;
  each_difference(trip, [&](int, int, double d) { around_mean += (d - out.all.mean_m) * (d - out.all.mean_m); });
  const auto n = static_cast<double>(out.all.posts);
  out.standard_deviation_m = n > 1 ? std::sqrt(around_mean / (n - 1)) : kNan;
  add_percentiles(trip, out);
  add_histogram(trip, out.histogram);
  add_quadrants(trip, out);
  add_slopes(trip, out);
  return out;
}

}  // namespace selenograph::engine
