#include "api/answers/moon_report.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <iterator>
#include <map>

#include "api/answers/table_cell.h"

namespace selenograph::api {
namespace {

using engine::DiscRow;

// Returns a text as a cell of CSV: quoted if it contains a comma.
std::string quoted(const std::string& text) { return text.find(',') == std::string::npos ? text : "\"" + text + "\""; }

// Smallest and largest of the ratios added; NaN is ignored.
struct RatioRange {
  double smallest = 1e300, largest = 0;
  void add(double ratio) {
    if (std::isnan(ratio)) return;
    smallest = std::min(smallest, ratio);
    largest = std::max(largest, ratio);
  }
  std::string text() const {
    if (largest == 0) return "";
    return largest - smallest < 5e-4 ? fmt::format("{:.3f}", smallest)
                                     : fmt::format("{:.3f} to {:.3f}", smallest, largest);
  }
};

// Returns true for bands in which LIME was fitted: only there are presets compared.
bool in_lime(const DiscRow& row) { return row.wavelength_um > 0.4399 && row.wavelength_um < 1.6401; }

// Returns a table of ratios to a model: a row per preset, a column per phase angle, each with its range over the bands.
// `ground` is "sphere" or "terrain", `model` the model's reflectance in a row of the report, `name` the model's name.
std::string disc_table(const MoonReport& report, const std::string& ground, double DiscRow::*model, const char* name) {
  constexpr double kShown_deg[] = {2, 5, 7, 15, 30, 45, 60, 75, 90};  // phase angles, waxing; waning is negative
  std::map<std::string, std::map<double, RatioRange>> ranges;         // by preset and phase angle, degrees
  std::vector<std::string> presets;
  for (const DiscRow& row : report.discs) {
    if (row.ground != ground || !in_lime(row)) continue;
    if (!ranges.contains(row.preset)) presets.push_back(row.preset);
    ranges[row.preset][row.phase_deg].add(row.reflectance / row.*model);
  }
  if (presets.empty()) return {};
  std::string out = fmt::format("\n| {}, over {} |", ground, name), rule_below_head = "\n|---|";
  std::vector<double> columns_deg;
  for (const double shown_deg : kShown_deg)
    for (const double phase_deg : {shown_deg, -shown_deg})
      if (ranges[presets.front()].contains(phase_deg)) {
        columns_deg.push_back(phase_deg);
        out += fmt::format(" {:g} |", phase_deg);
        rule_below_head += "---|";
      }
  out += rule_below_head + "\n";
  for (const std::string& preset : presets) {
    out += fmt::format("| {} |", preset);
    for (const double phase_deg : columns_deg) out += fmt::format(" {} |", ranges[preset][phase_deg].text());
    out += "\n";
  }
  return out;
}

// Adds a line for each disc outside the bounds, which the header lists.
void check_discs(const MoonReport& report, std::vector<std::string>& violations) {
  // Sums of the rendered reflectance and LIME's over waxing and waning, by wavelength and phase.
  std::map<std::pair<double, double>, std::pair<double, double>> terrain_sums;
  for (const DiscRow& row : report.discs) {
    const double phase_deg = std::abs(row.phase_deg), ratio = row.reflectance / row.lime;
    if (row.preset != "moon" || !in_lime(row) || std::isnan(ratio)) continue;
    if (row.ground == "terrain") {
      auto& [rendered, lime] = terrain_sums[{row.wavelength_um, phase_deg}];
      rendered += row.reflectance;
      lime += row.lime;
    }
    const double bound = phase_deg >= 5 ? 0.01 : 0.02;
    if (row.ground == "sphere" && std::abs(ratio - 1) > bound)
      violations.push_back(fmt::format("moon on a sphere, {:g} um, {:g} degrees: {:.4f} of LIME", row.wavelength_um,
                                       row.phase_deg, ratio));
  }
  for (const auto& [band_and_phase, sums] : terrain_sums)
    if (const double mean = sums.first / sums.second; std::abs(mean - 1) > 0.03)
      violations.push_back(fmt::format("moon on terrain, {:g} um, {:g} degrees: {:.4f} of LIME", band_and_phase.first,
                                       band_and_phase.second, mean));
}

// Adds a line for each image outside the bounds. A comparison that fails for NaN counts as a violation.
void check_images(const MoonReport& report, std::vector<std::string>& violations) {
  std::map<std::string, RatioRange> scales;
  for (const ImageRow& row : report.images) {
    const engine::DiscComparison& c = row.comparison;
    const std::string name = row.image + " " + row.channel;
    if (!(c.correlation >= (row.wavelength_um < 1 ? 0.995 : 0.985)))
      violations.push_back(fmt::format("{}: correlation {:.4f}", name, c.correlation));
    if (!(std::abs(c.scale - 1) <= 0.1)) violations.push_back(fmt::format("{}: scale {:.3f}", name, c.scale));
    if (!(std::abs(c.limb_px) <= 0.1)) violations.push_back(fmt::format("{}: limb off by {:.3f} px", name, c.limb_px));
    scales[row.channel].add(c.scale);
  }
  for (const auto& [channel, range] : scales)
    if (range.largest / range.smallest > 1.02)
      violations.push_back(fmt::format("{}: scales from {:.3f} to {:.3f}", channel, range.smallest, range.largest));
}

}  // namespace

std::string disc_csv(const MoonReport& report) {
  std::string out = "preset,wavelength_um,phase_deg,reflectance,rolo,lime,ground\n";
  for (const DiscRow& row : report.discs)
    fmt::format_to(std::back_inserter(out), "{},{:g},{:g},{},{},{},{}\n", quoted(row.preset), row.wavelength_um,
                   row.phase_deg, cell(row.reflectance), cell(row.rolo), cell(row.lime), row.ground);
  return out;
}

std::string relief_csv(const MoonReport& report) {
  std::string out = "incidence_deg,ratio,shadowed,post_spacing_m\n";
  for (const engine::ReliefRow& row : report.relief)
    fmt::format_to(std::back_inserter(out), "{:g},{:.5f},{:.5f},{:g}\n", row.incidence_deg, row.ratio, row.shadowed,
                   row.post_spacing_m);
  return out;
}

std::string images_csv(const MoonReport& report) {
  std::string out = "image,channel,correlation,scale,limb_px,dx_px,dy_px";
  for (const char* region : engine::kDiscRegions) out += fmt::format(",residual_{}", region);
  out += "\n";
  for (const ImageRow& row : report.images) {
    fmt::format_to(std::back_inserter(out), "{},{},{:.5f},{:.4f},{:.4f},{:g},{:g}", quoted(row.image), row.channel,
                   row.comparison.correlation, row.comparison.scale, row.comparison.limb_px, row.registration.dx_px,
                   row.registration.dy_px);
    for (const double residual : row.comparison.residual)
      fmt::format_to(std::back_inserter(out), ",{}", cell(residual, "{:.4f}"));
    out += "\n";
  }
  return out;
}

std::string moon_markdown(const MoonReport& report) {
  std::string out =
      "Disc-equivalent reflectance over the model's, by phase angle in degrees (negative: waning); smallest and "
      "largest\nratio in the bands from 0.44 to 1.64 um.\n";
  for (const char* ground : {"sphere", "terrain"}) {
    out += disc_table(report, ground, &DiscRow::lime, "LIME");
    out += disc_table(report, ground, &DiscRow::rolo, "ROLO");
  }
  if (!report.relief.empty()) {
    out += fmt::format("\n| incidence, degrees | brightness over smooth ground | shadowed |\n|---|---|---|\n");
    for (const engine::ReliefRow& row : report.relief)
      out += fmt::format("| {:g} | {:.3f} | {:.3f} |\n", row.incidence_deg, row.ratio, row.shadowed);
  }
  if (report.images.empty()) return out;
  out += fmt::format(
      "\nPoint spread: {:.2f} pixels (standard deviation), the same for all. Residuals are RMS over the region's "
      "mean.\n"
      "\n| image | channel | moved, px | correlation | scale | limb, px | {} |\n"
      "|---|---|---|---|---|---|---|---|---|---|\n",
      report.point_spread_px, fmt::join(engine::kDiscRegions, " | "));
  for (const ImageRow& row : report.images) {
    const engine::DiscComparison& c = row.comparison;
    out += fmt::format("| {} | {} | {:.2f}, {:.2f} | {:.4f} | {:.3f} | {:.3f} |", row.image, row.channel,
                       row.registration.dx_px, row.registration.dy_px, c.correlation, c.scale, c.limb_px);
    for (const double residual : c.residual) out += fmt::format(" {} |", cell(residual, "{:.3f}"));
    out += "\n";
  }
  return out;
}

std::vector<std::string> bound_violations(const MoonReport& report) {
  std::vector<std::string> out;
  check_discs(report, out);
  check_images(report, out);
  return out;
}

}  // namespace selenograph::api
