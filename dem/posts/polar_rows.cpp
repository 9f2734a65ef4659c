#include "dem/posts/polar_rows.h"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace selenograph::dem {
namespace {

constexpr double kSmoothPosts = 8, kPolarPosts = 16;
constexpr std::size_t kHarmonics = 64;
constexpr double kPi = std::numbers::pi;

// How much of a row's m-th harmonic is its own: waves of two posts are number pi times the distance from the pole.
double resolved(std::size_t m, double posts) {
  if (m == 0) return 1;
  const double waves = static_cast<double>(m) / (kPi * posts);
  const double past = std::clamp((waves - 0.65) / 0.6, 0.0, 1.0);
  return 0.5 + 0.5 * std::cos(kPi * past);
}

// Voids are bridged along the row. False if half of it is void.
bool bridge(std::vector<float>& row) {
  std::vector<std::size_t> valid;
  for (std::size_t i = 0; i < row.size(); ++i)
    if (!std::isnan(row[i])) valid.push_back(i);
  if (2 * valid.size() < row.size()) return false;
  for (std::size_t k = 0; k < valid.size(); ++k) {
    const std::size_t from = valid[k], to = k + 1 < valid.size() ? valid[k + 1] : valid[0] + row.size();
    const auto a = static_cast<double>(row[from]), b = static_cast<double>(row[to % row.size()]);
    for (std::size_t i = from + 1; i < to; ++i)
      row[i % row.size()] =
          static_cast<float>(a + (b - a) * static_cast<double>(i - from) / static_cast<double>(to - from));
  }
  return true;
}

std::vector<std::complex<double>> harmonics_of(const std::vector<float>& row) {
  const std::size_t n = row.size();
  std::vector<std::complex<double>> turns(n), found(std::min(kHarmonics, n / 2));
  for (std::size_t i = 0; i < n; ++i)
    turns[i] = std::polar(1.0, -2 * kPi * static_cast<double>(i) / static_cast<double>(n));
  for (std::size_t m = 0; m < found.size(); ++m) {
    std::complex<double> sum = 0;
    for (std::size_t i = 0, at = 0; i < n; ++i, at = (at + m) % n) sum += static_cast<double>(row[i]) * turns[at];
    found[m] = (m == 0 ? 1.0 : 2.0) * sum / static_cast<double>(n);
  }
  return found;
}

double height_at(const std::vector<std::complex<double>>& harmonics, double angle) {
  const std::complex<double> turn = std::polar(1.0, angle);
  std::complex<double> sum = 0;
  for (auto c = harmonics.rbegin(); c != harmonics.rend(); ++c) sum = sum * turn + *c;
  return sum.real();
}

// The share of the smooth row, C1.
double share_at(double posts) {
  const double x = std::clamp((kPolarPosts - posts) / (kPolarPosts - kSmoothPosts), 0.0, 1.0);
  return x * x * (3 - 2 * x);
}

}  // namespace

bool PolarRows::any(const RasterInfo& info) {
  if (!info.wraps_longitude || info.projection() != Projection::geographic) return false;
  const PolarRows rows(info);
  return rows.posts_from_pole(0, true) < 1 || rows.posts_from_pole(info.height - 1, false) < 1;
}

// Negative beyond it.
double PolarRows::posts_from_pole(int y, bool north) const {
  const auto& grid = std::get<GeographicGrid>(info_.grid);
  return north ? (90 - grid.first_lat_deg) * grid.lat_posts_per_degree + y
               : (90 + grid.first_lat_deg) * grid.lat_posts_per_degree - y;
}

std::vector<PolarRows::Ring> PolarRows::rings_at(bool north, const ReadRow& read) const {
  std::vector<Ring> rings;
  std::vector<float> row(static_cast<std::size_t>(info_.width));
  const int first = north ? 0 : info_.height - 1, step = north ? 1 : -1;
  if (posts_from_pole(first, north) >= 1) return {};
  for (int y = first; y >= 0 && y < info_.height; y += step) {
    const double posts = posts_from_pole(y, north);
    if (posts >= kPolarPosts) break;
    read(y, row.data());
    if (!bridge(row)) return {};
    rings.push_back({posts, harmonics_of(row)});
  }
  for (std::size_t k = rings.size(); k-- > 0;)
    for (std::size_t m = 0; m < rings[k].harmonics.size(); ++m) {
      const double own = resolved(m, rings[k].posts);
      std::complex<double>& c = rings[k].harmonics[m];
      c *= own;
      if (k + 1 < rings.size() && own < 1)
        c += (1 - own) * rings[k + 1].harmonics[m] *
             std::pow(rings[k].posts / rings[k + 1].posts, static_cast<double>(m));
    }
  return rings;
}

void PolarRows::smooth(int x0, int y0, int w, int h, float* heights_m, const ReadRow& read) const {
  for (const bool north : {false, true}) {
    const int nearest = north ? y0 : y0 + h - 1;
    if (posts_from_pole(nearest, north) >= kPolarPosts) continue;
    Pole& pole = poles_[north ? 1 : 0];
    std::call_once(pole.once, [&] { pole.rings = rings_at(north, read); });
    for (int j = 0; j < h; ++j) {
      const double posts = posts_from_pole(y0 + j, north);
      const auto ring = std::find_if(pole.rings.begin(), pole.rings.end(),
                                     [&](const Ring& r) { return std::abs(r.posts - std::abs(posts)) < 1e-6; });
      if (ring == pole.rings.end()) continue;
      const double share = share_at(ring->posts), turn = posts < 0 ? kPi : 0;
      float* row = heights_m + static_cast<std::ptrdiff_t>(j) * w;
      for (int i = 0; i < w; ++i) {
        const double angle = turn + 2 * kPi * static_cast<double>(x0 + i) / info_.width;
        const auto own = static_cast<double>(row[i]);
        row[i] = static_cast<float>(own + share * (height_at(ring->harmonics, angle) - own));
      }
    }
  }
}

}  // namespace selenograph::dem
