#include "api/answers/ground_report.h"

#include <fmt/format.h>

#include <cmath>

#include "api/answers/table_cell.h"

namespace selenograph::api {

std::string slopes_csv(const GroundReport& report) {
  std::string out =
      "baseline_m,rms_deg,median_deg,hurst,craters_share,relief_share,published_median_deg,clods_share,steepest_deg\n";
  for (const engine::SlopeRow& r : report.slopes)
    out += fmt::format("{:g},{:.4f},{:.4f},{},{:.4f},{:.4f},{},{:.4f},{:.4f}\n", r.baseline_m, r.rms_deg, r.median_deg,
                       cell(r.hurst, "{:.4f}"), r.craters_share, r.relief_share, cell(r.published_deg, "{:.4f}"),
                       r.clods_share, r.steepest_deg);
  return out;
}

std::string craters_csv(const GroundReport& report) {
  std::string out = "diameter_m,law,listed,visible\n";
  for (const engine::CraterRow& r : report.craters)
    out += fmt::format("{:g},{:.6g},{:.6g},{:.6g}\n", r.diameter_m, r.law, r.listed, r.visible);
  return out;
}

std::string albedo_csv(const GroundReport& report) {
  std::string out = "pixel_m,mean,deviation,bright_share\n";
  for (const engine::AlbedoRow& r : report.albedo)
    out += fmt::format("{:g},{:.4f},{:.4f},{:.4f}\n", r.pixel_m, r.mean, r.deviation, r.bright_share);
  return out;
}

std::string ground_markdown(const GroundReport& report) {
  std::string out = fmt::format(
      "| {}: baseline, m | RMS slope, degrees | median | published median | Hurst exponent | craters' share of the "
      "variance | relief's | clods' | 99 % of slopes |\n|---|---|---|---|---|---|---|---|---|\n",
      report.detail);
  for (const engine::SlopeRow& r : report.slopes)
    out += fmt::format("| {:g} | {:.2f} | {:.2f} | {} | {} | {:.2f} | {:.2f} | {:.2f} | {:.1f} |\n", r.baseline_m,
                       r.rms_deg, r.median_deg, cell(r.published_deg, "{:.2f}"), cell(r.hurst, "{:.2f}"),
                       r.craters_share, r.relief_share, r.clods_share, r.steepest_deg);
  // A row's octave ends at the next power of two above its smallest diameter.
  out += "\n| diameters, m | the law's, per km^2 | visible, over the law's |\n|---|---|---|\n";
  for (const engine::CraterRow& r : report.craters)
    out += fmt::format("| {:g} to {:g} | {:.4g} | {:.2f} |\n", r.diameter_m,
                       std::exp2(std::floor(std::log2(r.diameter_m)) + 1), r.law, r.visible / r.law);
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
  for (const engine::SlopeRow& r : report.slopes) {
    if (r.baseline_m < 0.5 && (r.hurst < 0.55 || r.hurst > 0.85))
      violations.push_back(fmt::format("Hurst exponent up to {:g} m: {:.2f}", r.baseline_m, r.hurst));
    if (r.baseline_m == 0.007 && !(r.median_deg > 8 && r.median_deg < 12 && r.steepest_deg > 40))
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
  for (const engine::AlbedoRow& r : report.albedo)
    if (std::abs(r.mean - 1) > 0.03)
      violations.push_back(fmt::format("mean factor of the albedo in pixels of {:g} m: {:.3f}", r.pixel_m, r.mean));
  return violations;
}

}  // namespace selenograph::api
