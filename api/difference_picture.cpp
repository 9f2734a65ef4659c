#include "api/difference_picture.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <utility>

#include "api/plot_axes.h"

namespace selenograph::api {
namespace {

constexpr double kWidth = 1000, kHeight = 560, kTop = 66;
constexpr double kMapSide = 430, kMapLeft = 72, kHistogramLeft = 692, kHistogramWidth = 276, kHistogramHeight = 220;
constexpr int kMostPixels = 1000, kBins = 61;
constexpr Colour kNotCompared{0.62, 0.62, 0.62};

struct Unit {
  const char* name;
  double metres;
};

Unit unit_for(double length_m) {
  constexpr Unit kUnits[] = {{"pm", 1e-12}, {"nm", 1e-9}, {"µm", 1e-6}, {"mm", 1e-3}, {"m", 1}};
  Unit best = kUnits[0];
  for (const Unit& u : kUnits)
    if (std::abs(length_m) >= 0.1 * u.metres) best = u;
  return best;
}

std::string with_minus(std::string number) {
  if (!number.empty() && number.front() == '-') number.replace(0, 1, "\u2212");
  return number;
}

// ColorBrewer's RdBu, blue for below (Brewer et al. 2003): light in the middle, as dark at both ends.
Colour diverging(double at) {
  constexpr std::array<Colour, 9> kStops{{{0.020, 0.188, 0.380},
                                          {0.129, 0.400, 0.674},
                                          {0.263, 0.576, 0.765},
                                          {0.573, 0.773, 0.871},
                                          {0.969, 0.969, 0.969},
                                          {0.957, 0.647, 0.510},
                                          {0.839, 0.376, 0.302},
                                          {0.698, 0.094, 0.168},
                                          {0.404, 0.000, 0.122}}};
  const double place = (std::clamp(at, -1.0, 1.0) + 1) / 2 * (kStops.size() - 1);
  const auto i = std::min(static_cast<std::size_t>(place), kStops.size() - 2);
  const double f = place - static_cast<double>(i);
  const Colour &a = kStops[i], &b = kStops[i + 1];
  return {a.r + f * (b.r - a.r), a.g + f * (b.g - a.g), a.b + f * (b.b - a.b)};
}

void put(std::vector<std::uint8_t>& rgb, const Colour& c) {
  for (const double v : {c.r, c.g, c.b}) rgb.push_back(static_cast<std::uint8_t>(std::lround(255 * v)));
}

// One, two, three or five times a power of ten: the first that is not below.
double rounded_up(double x) {
  if (!(x > 0)) return 1e-9;
  const double power = std::pow(10.0, std::floor(std::log10(x)));
  for (const double digit : {1.0, 2.0, 3.0, 5.0})
    if (digit * power >= x * (1 - 1e-9)) return digit * power;
  return 10 * power;
}

class Drawing {
 public:
  Drawing(const engine::RoundTrip& trip, const engine::DifferenceStatistics& s)
      : trip_(trip), s_(s), canvas_(kWidth, kHeight) {
    reach_m_ = rounded_up(percentile_of_size(99.5));
    unit_ = unit_for(reach_m_);
  }

  Canvas draw(const std::string& title) {
    canvas_.text({kMapLeft, 28}, title, {.size = 15, .bold = true});
    canvas_.text({kMapLeft, 48}, subtitle(), {.size = 11, .colour = kPaleInk});
    const Rectangle map = draw_map();
    draw_colour_bar({map.right() + 22, map.y, 14, map.height});
    draw_histogram();
    draw_figures(kTop + kHistogramHeight + 72);
    return std::move(canvas_);
  }

 private:
  double percentile_of_size(double percent) const {
    std::vector<float> sizes;
    for (const float d : trip_.difference_m)
      if (!std::isnan(d)) sizes.push_back(std::abs(d));
    if (sizes.empty()) return 0;
    const auto nth = static_cast<std::size_t>(percent / 100 * static_cast<double>(sizes.size() - 1));
    std::nth_element(sizes.begin(), sizes.begin() + static_cast<std::ptrdiff_t>(nth), sizes.end());
    return static_cast<double>(sizes[nth]);
  }

  std::string subtitle() const {
    return fmt::format("{} of {} posts compared, {} hidden, {} missed, {} void{}", trip_.compared, trip_.window.size(),
                       trip_.hidden, trip_.missed, trip_.voids,
                       trip_.elsewhere > 0 ? fmt::format(", {} under a finer tile", trip_.elsewhere) : "");
  }

  // Mean over squares of k x k posts.
  std::pair<int, int> map_pixels(std::vector<std::uint8_t>& rgb) const {
    const engine::PostWindow& w = trip_.window;
    const int k = (std::max(w.width, w.height) + kMostPixels - 1) / kMostPixels;
    const int columns = (w.width + k - 1) / k, rows = (w.height + k - 1) / k;
    for (int y = 0; y < rows; ++y)
      for (int x = 0; x < columns; ++x) {
        double sum = 0;
        int count = 0;
        for (int r = y * k; r < std::min((y + 1) * k, w.height); ++r)
          for (int c = x * k; c < std::min((x + 1) * k, w.width); ++c)
            if (const float d = trip_.difference_m[w.index(r, c)]; !std::isnan(d))
              sum += static_cast<double>(d), ++count;
        put(rgb, count > 0 ? diverging(sum / count / reach_m_) : kNotCompared);
      }
    return {columns, rows};
  }

  Rectangle draw_map() {
    const engine::PostWindow& w = trip_.window;
    const double lat_step = w.lat_step_deg(), lon_step = w.lon_step_deg();
    const Geographic first = w.place(0, 0);
    const double north = first.lat_deg + lat_step / 2, south = north - lat_step * w.height;
    const double west = first.lon_deg - lon_step / 2, east = west + lon_step * w.width;
    // As it lies on the ground, halfway up.
    const double flat = (east - west) * std::cos((north + south) / 2 * std::numbers::pi / 180) / (north - south);
    const Rectangle area{kMapLeft, kTop, kMapSide * std::min(1.0, flat), kMapSide / std::max(1.0, flat)};
    std::vector<std::uint8_t> rgb;
    const auto [columns, rows] = map_pixels(rgb);
    canvas_.picture(area, columns, rows, rgb);
    const PlotAxes axes(area, {.min = west, .max = east, .label = "longitude, degrees east", .grid = false},
                        {.min = south, .max = north, .label = "latitude, degrees north", .grid = false});
    axes.draw_frame(canvas_);
    return area;
  }

  void draw_colour_bar(const Rectangle& bar) {
    constexpr int kSteps = 128;
    std::vector<std::uint8_t> rgb;
    for (int i = 0; i < kSteps; ++i) put(rgb, diverging(1 - 2 * (i + 0.5) / kSteps));
    canvas_.picture(bar, 1, kSteps, rgb);
    const double reach = reach_m_ / unit_.metres;
    const PlotAxes axes(bar, {.numbers = Numbers::none, .grid = false},
                        {.min = -reach,
                         .max = reach,
                         .label = fmt::format("extracted \u2212 original, {}", unit_.name),
                         .numbers = Numbers::far,
                         .grid = false});
    axes.draw_frame(canvas_);
  }

  void draw_histogram() {
    std::vector<double> share(kBins, 0);
    const double bin_m = 2 * reach_m_ / kBins;
    for (const float d : trip_.difference_m) {
      if (std::isnan(d)) continue;
      const double bin = (static_cast<double>(d) + reach_m_) / bin_m;
      if (bin >= 0 && bin < kBins) share[static_cast<std::size_t>(bin)] += 100.0 / static_cast<double>(trip_.compared);
    }
    const double reach = reach_m_ / unit_.metres, bin = bin_m / unit_.metres;
    const double highest = std::max(1e-9, *std::max_element(share.begin(), share.end()));
    const PlotAxes axes(
        {kHistogramLeft, kTop, kHistogramWidth, kHistogramHeight},
        {.min = -reach, .max = reach, .label = fmt::format("extracted \u2212 original, {}", unit_.name)},
        {.min = 0, .max = 1.08 * highest, .label = "share of posts, %"});
    axes.draw_grid(canvas_);
    for (int i = 0; i < kBins; ++i) {
      const double from = -reach + i * bin;
      const double top = axes.y(share[static_cast<std::size_t>(i)]), left = axes.x(from);
      canvas_.fill(Rectangle{left, top, axes.x(from + bin) - left, axes.area().bottom() - top},
                   diverging((i + 0.5) * 2 / kBins - 1));
    }
    outline(axes, share, reach, bin);
    axes.draw_frame(canvas_);
  }

  // So that the pale middle shows, too.
  void outline(const PlotAxes& axes, const std::vector<double>& share, double reach, double bin) {
    std::vector<Point> steps;
    for (int i = 0; i < kBins; ++i)
      for (const int side : {0, 1})
        steps.push_back(axes.at(-reach + (i + side) * bin, share[static_cast<std::size_t>(i)]));
    canvas_.polyline(steps, {.colour = kPaleInk, .width = 0.7});
  }

  void figure(double& y, const std::string& what, const std::string& value) {
    canvas_.text({kHistogramLeft - 30, y}, what, {.size = 11, .colour = kPaleInk});
    canvas_.text({kHistogramLeft + 90, y}, value, {.size = 11});
    y += 17;
  }

  void draw_figures(double y) {
    const engine::GroupStatistics& all = s_.all;
    const std::string error = std::isnan(all.standard_error_m) ? "" : " ± " + length_text(all.standard_error_m);
    figure(y, "mean", length_text(all.mean_m) + error);
    figure(y, "mean of size", length_text(all.mean_absolute_m));
    figure(y, "median", length_text(s_.median_m));
    figure(y, "rms", length_text(all.rms_m));
    for (const engine::Percentile& p : s_.absolute_percentiles)
      if (p.percent > 95) figure(y, fmt::format("{:g} % within", p.percent), length_text(p.value_m));
    figure(y, "worst", worst());
    y += 4;
    for (const engine::Quadrant& q : s_.quadrants)
      figure(y, fmt::format("mean in the {}", q.name), quadrant(q.statistics));
  }

  std::string worst() const {
    if (s_.worst_row < 0) return "none";
    const Geographic g = trip_.window.place(s_.worst_row, s_.worst_col);
    return length_text(s_.worst_m) + with_minus(fmt::format("{:.4f}", g.lat_deg)).insert(0, " at ") + "°, " +
           with_minus(fmt::format("{:.4f}", g.lon_deg)) + "°";
  }

  static std::string quadrant(const engine::GroupStatistics& g) {
    if (std::isnan(g.z)) return length_text(g.mean_m);
    return length_text(g.mean_m) + " ± " + length_text(g.standard_error_m) +
           with_minus(fmt::format("{:.1f}", g.z)).insert(0, "  (") + " σ)";
  }

  const engine::RoundTrip& trip_;
  const engine::DifferenceStatistics& s_;
  Canvas canvas_;
  double reach_m_ = 0;
  Unit unit_{};
};

}  // namespace

std::string length_text(double length_m) {
  if (std::isnan(length_m)) return "none";
  if (length_m == 0) return "0 m";
  const Unit unit = unit_for(length_m);
  return with_minus(fmt::format("{:.3g} {}", length_m / unit.metres, unit.name));
}

Canvas difference_picture(const engine::RoundTrip& trip, const engine::DifferenceStatistics& statistics,
                          const std::string& title) {
  return Drawing(trip, statistics).draw(title);
}

}  // namespace selenograph::api
