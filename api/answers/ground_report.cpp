#include "api/answers/ground_report.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "api/answers/table_cell.h"

namespace selenograph::api {

std::string slopes_csv(const GroundReport& report) {
  std::string out =
      "baseline_m,rms_deg,median_deg,hurst,craters_share,relief_share,published_median_deg,clods_share,steepest_deg,"
      "fragments_share\n";
  for (const engine::SlopeRow& r : report.slopes)
    out += fmt::format("{:g},{:.4f},{:.4f},{},{:.4f},{:.4f},{},{:.4f},{:.4f},{:.4f}\n", r.baseline_m, r.rms_deg,
                       r.median_deg, cell(r.hurst, "{:.4f}"), r.craters_share, r.relief_share,
                       cell(r.published_deg, "{:.4f}"), r.clods_share, r.steepest_deg, r.fragments_share);
  return out;
}

std::string craters_csv(const GroundReport& report) {
  std::string out = "diameter_m,law,listed,visible,depth_over_diameter\n";
  for (const engine::CraterRow& r : report.craters)
    out += fmt::format("{:g},{:.6g},{:.6g},{:.6g},{}\n", r.diameter_m, r.law, r.listed, r.visible,
                       cell(r.depth_over_diameter, "{:.4f}"));
  return out;
}

std::string albedo_csv(const GroundReport& report) {
  std::string out = "pixel_m,mean,deviation,bright_share\n";
  for (const engine::AlbedoRow& r : report.albedo)
    out += fmt::format("{:g},{:.4f},{:.4f},{:.4f}\n", r.pixel_m, r.mean, r.deviation, r.bright_share);
  return out;
}

std::string rocks_csv(const GroundReport& report) {
  std::string out = "diameter_m,law,area,fragments\n";
  for (const engine::RockRow& r : report.rocks)
    out += fmt::format("{:g},{:.6g},{:.6g},{:.6g}\n", r.diameter_m, r.law, r.area, r.fragments);
  return out;
}

namespace {

// Returns the end of an octave: the next power of two above its smallest diameter.
double past_octave_m(double smallest_m) { return std::exp2(std::floor(std::log2(smallest_m)) + 1); }

std::string small_ground_markdown(const GroundReport& report) {
  std::string out;
  if (!report.rocks.empty())
    out += "\n| diameters, m | rocks' area, by the law | over the law's | fragments |\n|---|---|---|---|\n";
  for (const engine::RockRow& r : report.rocks)
    out += fmt::format("| {:.3g} to {:.3g} | {:.3f} % | {:.2f} | {:.3f} % |\n", r.diameter_m,
                       past_octave_m(r.diameter_m), 100 * r.law, r.area / r.law, 100 * r.fragments);
  if (!report.roughness.empty())
    out +=
        "\n| window, mm | RMS height about a plane, mm: median | 5 % to 95 % | about the mean: median "
        "|\n|---|---|---|---|\n";
  for (const engine::RoughnessRow& r : report.roughness)
    out += fmt::format("| {:g} | {:.1f} | {:.1f} to {:.1f} | {:.1f} |\n", 1000 * r.window_m, 1000 * r.median_m,
                       1000 * r.low_m, 1000 * r.high_m, 1000 * r.median_about_mean_m);
  return out;
}

}  // namespace

std::string ground_markdown(const GroundReport& report) {
  std::string out = fmt::format(
      "| {}: baseline, m | RMS slope, degrees | median | published median | Hurst exponent | craters' share of the "
      "variance | relief's | clods' | fragments' | 99 % of slopes |\n|---|---|---|---|---|---|---|---|---|---|\n",
      report.detail);
  for (const engine::SlopeRow& r : report.slopes)
    out += fmt::format("| {:g} | {:.2f} | {:.2f} | {} | {} | {:.2f} | {:.2f} | {:.2f} | {:.2f} | {:.1f} |\n",
                       r.baseline_m, r.rms_deg, r.median_deg, cell(r.published_deg, "{:.2f}"), cell(r.hurst, "{:.2f}"),
                       r.craters_share, r.relief_share, r.clods_share, r.fragments_share, r.steepest_deg);
  out += "\n| diameters, m | the law's, per km^2 | visible, over the law's | their depth over diameter |\n";
  out += "|---|---|---|---|\n";
  for (const engine::CraterRow& r : report.craters)
    out += fmt::format("| {:g} to {:g} | {:.4g} | {:.2f} | {} |\n", r.diameter_m, past_octave_m(r.diameter_m), r.law,
                       r.visible / r.law, cell(r.depth_over_diameter, "{:.3f}"));
  out += small_ground_markdown(report);
  if (report.albedo.empty()) return out;
  out += "\n| pixel, m | albedo over the constant one: mean | standard deviation | 30 % brighter than the median |\n";
  out += "|---|---|---|---|\n";
  for (const engine::AlbedoRow& r : report.albedo)
    out += fmt::format("| {:g} | {:.3f} | {:.3f} | {:.1f} % |\n", r.pixel_m, r.mean, r.deviation, 100 * r.bright_share);
  return out;
}

// The header lists the bounds.
std::vector<std::string> bound_violations(const GroundReport& report) {
  std::vector<std::string> violations;
  // Chang'e-4's ground is a mare. On steeper ground, longer relief adds to the slopes over millimetres.
  constexpr double kSteep_deg = 5;
  const bool is_gentle = std::any_of(report.slopes.begin(), report.slopes.end(), [](const engine::SlopeRow& r) {
    return r.baseline_m == 0.5 && r.published_deg < kSteep_deg;
  });
  for (const engine::SlopeRow& r : report.slopes) {
    if (is_gentle && r.baseline_m < 0.5 && (r.hurst < 0.55 || r.hurst > 0.85))
      violations.push_back(fmt::format("Hurst exponent up to {:g} m: {:.2f}", r.baseline_m, r.hurst));
    if (is_gentle && r.baseline_m == 0.007 && !(r.median_deg > 8 && r.median_deg < 12 && r.steepest_deg > 40))
      violations.push_back(fmt::format("slopes over 7 mm: median {:.1f}, 99 % {:.1f} degrees; measured: 10, over 40",
                                       r.median_deg, r.steepest_deg));
    if (r.baseline_m > 100) continue;
    if (std::abs(r.median_deg / r.published_deg - 1) > 0.2)
      violations.push_back(fmt::format("median slope over {:g} m: {:.2f} degrees, published {:.2f}", r.baseline_m,
                                       r.median_deg, r.published_deg));
    if (r.baseline_m > 1 && (r.hurst < 0.65 || r.hurst > 1.05))
      violations.push_back(fmt::format("Hurst exponent up to {:g} m: {:.2f}", r.baseline_m, r.hurst));
  }
  for (const engine::CraterRow& r : report.craters) {
    const double ratio = r.visible / r.law;
    if (r.diameter_m >= 2 && r.diameter_m < 50 && !(ratio > 0.8 && ratio < 1.25))
      violations.push_back(fmt::format("visible craters from {:g} m: {:.2f} of the law's", r.diameter_m, ratio));
  }
  for (const engine::RockRow& r : report.rocks)
    if (const double ratio = r.area / r.law; r.diameter_m < 4 && std::abs(ratio - 1) > 0.15)
      violations.push_back(fmt::format("area of rocks from {:g} m: {:.2f} of the law's", r.diameter_m, ratio));
  for (const engine::RoughnessRow& r : report.roughness)
    // Publications do not say whether the slope of the window is part of the RMS height.
    if (r.median_about_mean_m < 0.0025 || r.median_m > 0.005)
      violations.push_back(fmt::format("median RMS height in {:g} mm: {:.1f} to {:.1f} mm; measured: 4",
                                       1000 * r.window_m, 1000 * r.median_m, 1000 * r.median_about_mean_m));
  for (const engine::AlbedoRow& r : report.albedo)
    if (std::abs(r.mean - 1) > 0.03)
      violations.push_back(fmt::format("mean factor of the albedo in pixels of {:g} m: {:.3f}", r.pixel_m, r.mean));
  return violations;
}

}  // namespace selenograph::api
