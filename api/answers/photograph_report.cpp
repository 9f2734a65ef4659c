#include "api/answers/photograph_report.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <iterator>

#include "api/answers/table_cell.h"

namespace selenograph::api {
namespace {

constexpr std::size_t kMinTies = 30;
constexpr double kMinShadowShare = 0.01;

// Returns NaN for too few ties: they may all be false.
double root_mean_square(const std::vector<double>& values) {
  double sum = 0;
  for (const double value : values) sum += value * value;
  return values.size() < kMinTies ? std::nan("") : std::sqrt(sum / static_cast<double>(values.size()));
}

// A measure of one comparison; NaN where the comparison has none.
using MeasureOf = double (*)(const PhotographComparison&);
template <double engine::ShadowMeasures::*member>
double shadow_value(const PhotographComparison& c) {
  return c.measures.shadows ? *c.measures.shadows.*member : std::nan("");
}

// Appends the measures of a row.
void append_measures(const PhotographRow& row, std::vector<PhotographMeasure>& out) {
  const auto add = [&](const char* name, double low, double high, MeasureOf value) {
    out.push_back({row.name, name, low, high, value(row.sun), value(row.wrong_sun)});
  };
  const auto tie_rms = [](const PhotographComparison& c) { return root_mean_square(c.tie_distances_px); };
  const auto tone = [](const PhotographComparison& c) { return c.measures.tone; };
  const auto tone_blurred = [](const PhotographComparison& c) { return c.measures.tone_blurred; };
  const auto ratio = [](const PhotographComparison& c) { return c.measures.radiance_ratio; };
  if (row.is_radiance) add("radiance, photograph / frame", 0.88, 1.12, ratio);
  // A strip of a few lines of radiance has no room for ties, whose view is therefore taken as it is.
  if (row.is_radiance && row.sun.tie_distances_px.size() < kMinTies) return;
  add("ties held out, RMS, px", 0, 0.2, tie_rms);
  add("tone", 0.85, 1, tone);
  add("tone, photograph blurred by 1 px", 0.9, 1, tone_blurred);
  if (!row.sun.measures.shadows || row.sun.measures.shadows->photograph_share < kMinShadowShare) return;
  add("shadow area, frame / photograph", 0.9, 1.1, shadow_value<&engine::ShadowMeasures::area_ratio>);
  add("shadow overlap (IoU)", 0.8, 1, shadow_value<&engine::ShadowMeasures::overlap>);
  add("shadow edges, median, px", 0, 0.5, shadow_value<&engine::ShadowMeasures::edge_median_px>);
}

}  // namespace

std::vector<PhotographMeasure> measures_of(const PhotographReport& report) {
  std::vector<PhotographMeasure> out;
  for (const PhotographRow& row : report.rows) append_measures(row, out);
  return out;
}

std::string photographs_csv(const PhotographReport& report) {
  std::string out = "photograph,measure,low,high,value,wrong_sun\n";
  for (const PhotographMeasure& m : measures_of(report))
    fmt::format_to(std::back_inserter(out), "{},\"{}\",{:g},{:g},{},{}\n", m.photograph, m.name, m.low, m.high,
                   cell(m.value), cell(m.wrong_sun));
  return out;
}

namespace {

std::string bounds_words(const PhotographMeasure& m) {
  if (m.high == 1) return fmt::format("at least {:g}", m.low);
  if (m.low == 0) return fmt::format("at most {:g}", m.high);
  return fmt::format("{:g} to {:g}", m.low, m.high);
}

}  // namespace

std::string photographs_markdown(const PhotographReport& report) {
  std::string out;
  const std::vector<PhotographMeasure> measures = measures_of(report);
  for (const PhotographRow& row : report.rows) {
    fmt::format_to(std::back_inserter(out),
                   "\n{}: pixels of {:.0f} m, posts of {:.0f} m, {} ties held out\n\n| measure | bound | value | Sun "
                   "turned by 10 degrees "
                   "|\n|---|---|---|---|\n",
                   row.name, row.pixel_m, row.post_m, row.sun.tie_distances_px.size());
    for (const PhotographMeasure& m : measures)
      if (m.photograph == row.name)
        fmt::format_to(std::back_inserter(out), "| {} | {} | {}{} | {}{} |\n", m.name, bounds_words(m),
                       cell(m.value, "{:.4g}"), m.is_within_bounds() ? "" : " (missed)", cell(m.wrong_sun, "{:.4g}"),
                       m.wrong_sun_fails() ? "" : " (within)");
  }
  for (const std::string& what : report.skipped) fmt::format_to(std::back_inserter(out), "\nskipped: {}\n", what);
  return out;
}

std::vector<std::string> bound_violations(const PhotographReport& report) {
  std::vector<std::string> out;
  for (const PhotographMeasure& m : measures_of(report)) {
    if (!m.is_within_bounds())
      out.push_back(fmt::format("{}: {}: {:.4g} is not {}", m.photograph, m.name, m.value, bounds_words(m)));
    if (!m.wrong_sun_fails())
      out.push_back(
          fmt::format("{}: {}: {:.4g} with a wrong Sun is {}", m.photograph, m.name, m.wrong_sun, bounds_words(m)));
  }
  return out;
}

}  // namespace selenograph::api
