#include "api/accuracy_report.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <functional>

#include "api/frame_json.h"
#include "api/plot_axes.h"

namespace selenograph::api {
namespace {

using engine::SweepRow;

struct Column {
  const char* name;
  std::function<double(const SweepRow&)> value;
};

const std::vector<Column>& columns() {
  static const std::vector<Column> all{
      {"max_error_px", [](const SweepRow& r) { return r.setting.max_error_px; }},
      {"samples_per_pixel", [](const SweepRow& r) { return r.setting.samples_per_pixel; }},
      {"max_shadow_error_px", [](const SweepRow& r) { return r.setting.max_shadow_error_px; }},
      {"reference_max_error_px", [](const SweepRow& r) { return r.reference_max_error_px; }},
      {"frame_ms", [](const SweepRow& r) { return r.frame_ms; }},
      {"bare_kernel_ms", [](const SweepRow& r) { return r.bare_ms; }},
      {"time_ratio", [](const SweepRow& r) { return r.ratio(); }},
      {"triangles", [](const SweepRow& r) { return static_cast<double>(r.triangles); }},
      {"scene_bytes", [](const SweepRow& r) { return static_cast<double>(r.scene_bytes); }},
      {"lod_error_px", [](const SweepRow& r) { return r.bound_px; }},
      {"lod_error_m", [](const SweepRow& r) { return r.bound_m; }},
      {"shadow_error_px", [](const SweepRow& r) { return r.shadow_bound_px; }},
      {"geometric_median_px", [](const SweepRow& r) { return r.errors.geometric_px.median; }},
      {"geometric_p999_px", [](const SweepRow& r) { return r.errors.geometric_px.p999; }},
      {"geometric_worst_px", [](const SweepRow& r) { return r.errors.geometric_px.worst; }},
      {"geometric_median_m", [](const SweepRow& r) { return r.errors.geometric_m.median; }},
      {"geometric_p999_m", [](const SweepRow& r) { return r.errors.geometric_m.p999; }},
      {"geometric_worst_m", [](const SweepRow& r) { return r.errors.geometric_m.worst; }},
      {"within_lod_error_px", [](const SweepRow& r) { return r.errors.within_bound_px; }},
      {"within_lod_error_m", [](const SweepRow& r) { return r.errors.within_bound_m; }},
      {"wrong_hits", [](const SweepRow& r) { return r.errors.wrong_hits; }},
      {"radiance_rms", [](const SweepRow& r) { return r.errors.radiance_rms; }},
      {"radiance_p999", [](const SweepRow& r) { return r.errors.radiance_p999; }},
      {"wrong_shadow_flags", [](const SweepRow& r) { return r.errors.wrong_shadow_flags; }},
      {"shadow_edge_mean_px", [](const SweepRow& r) { return r.errors.shadow_edge_mean_px; }},
      {"shadow_edge_median_px", [](const SweepRow& r) { return r.errors.shadow_edge_px.median; }},
      {"shadow_edge_p999_px", [](const SweepRow& r) { return r.errors.shadow_edge_px.p999; }},
      {"shadow_edge_worst_px", [](const SweepRow& r) { return r.errors.shadow_edge_px.worst; }},
  };
  return all;
}

std::string markdown_row(const SweepRow& r) {
  const engine::ErrorMeasures& e = r.errors;
  return fmt::format(
      "| {} | {:g} | {:g} | {} | {:.2f} | {:.2f} | {:.0f} | {:.2f} | {:.3f} / {:.3f} / {:.3f} | {:.2g} / {:.2g} / "
      "{:.2g} | "
      "{:.2f} "
      "/ {:.1f} | "
      "{:.3f} / {:.1f} / {:.1f} | {:.3f} |\n",
      visibility_name(r.visibility), r.setting.max_error_px, r.setting.max_shadow_error_px, r.setting.samples_per_pixel,
      r.ratio(), static_cast<double>(r.triangles) / 1e6, static_cast<double>(r.scene_bytes) / 1048576.0, r.bound_px,
      e.geometric_px.median, e.geometric_px.p999, e.geometric_px.worst, e.geometric_m.median, e.geometric_m.p999,
      e.geometric_m.worst, 100 * e.radiance_rms, 100 * e.radiance_p999, e.shadow_edge_mean_px, e.shadow_edge_px.p999,
      e.shadow_edge_px.worst, 100 * e.wrong_shadow_flags);
}

constexpr const char* kMarkdownHead =
    "| visibility | max_error_px | max_shadow_error_px | samples | time / bare kernel | Mtriangles | MiB | bound px | "
    "geometric "
    "error px: median / 99.9 % "
    "/ "
    "worst | m: median / 99.9 % / worst | radiance %: RMS / 99.9 % | shadow edge px: mean / 99.9 % / worst | wrong "
    "shadow flags % |\n|---|--:|--:|--:|--:|--:|--:|--:|--:|--:|--:|--:|--:|\n";

struct Panel {
  std::string title, label;
  std::function<double(const SweepRow&)> error;
  bool all_samples;  // samples per pixel matter for radiance only
};

const std::vector<Panel>& panels() {
  static const std::vector<Panel> all{
      {"Where surface points appear", "99.9 % of the pixels are nearer than, px",
       [](const SweepRow& r) { return r.errors.geometric_px.p999; }, false},
      {"Shadow edges", "mean displacement, px", [](const SweepRow& r) { return r.errors.shadow_edge_mean_px; }, false},
      {"Radiance", "RMS error, % of the sunlit mean", [](const SweepRow& r) { return 100 * r.errors.radiance_rms; },
       true},
  };
  return all;
}

std::vector<std::string> scene_names(const std::vector<SweepRow>& rows) {
  std::vector<std::string> names;
  for (const SweepRow& r : rows)
    if (std::find(names.begin(), names.end(), r.scene) == names.end()) names.push_back(r.scene);
  return names;
}

constexpr double kTitle_pt = 13;
constexpr Marker kMarkers[] = {Marker::circle, Marker::square, Marker::diamond, Marker::triangle, Marker::cross};

CurveStyle style_of(std::size_t scene, engine::Visibility method = engine::Visibility::raytrace) {
  CurveStyle style;
  if (method == engine::Visibility::zbuffer) style.dashes = {4, 3}, style.marker_size = 4;
  style.colour = kPalette[scene % std::size(kPalette)];
  style.marker = kMarkers[scene % std::size(kMarkers)];
  return style;
}

// Points of one scene and one way to see in one panel: time against error, the error no lower than the axis begins.
std::vector<Point> points_of(const std::vector<SweepRow>& rows, const std::string& scene, engine::Visibility method,
                             const Panel& panel, double floor) {
  std::vector<Point> points;
  for (const SweepRow& r : rows)
    if (r.scene == scene && r.visibility == method && (panel.all_samples || r.setting.samples_per_pixel == 1))
      points.push_back({r.ratio(), std::max(floor, panel.error(r))});
  return points;
}

void draw_scene(Canvas& canvas, const PlotAxes& axes, const std::vector<Point>& points, CurveStyle style) {
  std::vector<double> times, errors;
  for (const Point& p : points) times.push_back(p.x), errors.push_back(p.y);
  const std::vector<bool> best = pareto_front(times, errors);
  std::vector<Point> front, rest;
  for (std::size_t i = 0; i < points.size(); ++i) (best[i] ? front : rest).push_back(points[i]);
  std::sort(front.begin(), front.end(), [](const Point& a, const Point& b) { return a.x < b.x; });
  axes.draw_curve(canvas, front, style);
  style.width = 0, style.marker_size = 4, style.colour.a = 0.35;
  axes.draw_curve(canvas, rest, style);
}

Axis error_axis(const std::vector<SweepRow>& rows, const Panel& panel) {
  std::vector<double> errors;
  errors.reserve(rows.size());
  for (const SweepRow& r : rows) errors.push_back(panel.error(r));
  // Rounding is no error worth four decades of paper.
  const double largest = *std::max_element(errors.begin(), errors.end());
  std::erase_if(errors, [&](double e) { return e < 1e-4 * largest; });
  return axis_around(errors, Scale::logarithmic, panel.label);
}

void draw_panel(Canvas& canvas, const Rectangle& area, const std::vector<SweepRow>& rows, const Panel& panel) {
  std::vector<double> times;
  for (const SweepRow& r : rows)
    if (panel.all_samples || r.setting.samples_per_pixel == 1) times.push_back(r.ratio());
  const PlotAxes axes(area, axis_around(times, Scale::logarithmic, "frame time / bare kernel on the finest mesh"),
                      error_axis(rows, panel));
  axes.draw_grid(canvas);
  const std::vector<std::string> scenes = scene_names(rows);
  for (std::size_t i = 0; i < scenes.size(); ++i)
    for (const engine::Visibility method : {engine::Visibility::raytrace, engine::Visibility::zbuffer})
      draw_scene(canvas, axes, points_of(rows, scenes[i], method, panel, axes.y_axis().min), style_of(i, method));
  axes.draw_frame(canvas);
  TextStyle title;
  title.size = kTitle_pt, title.bold = true;
  canvas.text({area.x, area.y - 10}, panel.title, title);
}

}  // namespace

std::vector<bool> pareto_front(const std::vector<double>& times, const std::vector<double>& errors) {
  std::vector<bool> best(times.size(), true);
  for (std::size_t i = 0; i < times.size(); ++i)
    for (std::size_t k = 0; k < times.size(); ++k)
      if (times[k] <= times[i] && errors[k] <= errors[i] && (times[k] < times[i] || errors[k] < errors[i]))
        best[i] = false;
  return best;
}

std::string accuracy_csv(const std::vector<SweepRow>& rows) {
  std::string csv = "scene,visibility";
  for (const Column& c : columns()) csv += fmt::format(",{}", c.name);
  csv += '\n';
  for (const SweepRow& r : rows) {
    csv += r.scene + "," + std::string(visibility_name(r.visibility));
    for (const Column& c : columns()) csv += fmt::format(",{:.9g}", c.value(r));
    csv += '\n';
  }
  return csv;
}

std::string accuracy_markdown(const std::vector<SweepRow>& rows, const std::vector<engine::AccuracyScene>& scenes,
                              const std::string& machine) {
  std::string text = fmt::format(
      "# Speed against error\n\nMeasured on {}. Time: a warm radiance frame over the bare ray-tracing kernel on the "
      "finest mesh with one sample per pixel, alternating, medians. Errors: against the finest terrain with many "
      "samples "
      "per pixel; radiance relative to the mean of the sunlit pixels.\n",
      machine);
  for (const engine::AccuracyScene& scene : scenes) {
    text += fmt::format("\n## {}: {}\n\n{}", scene.name, scene.what, kMarkdownHead);
    for (const SweepRow& r : rows)
      if (r.scene == scene.name) text += markdown_row(r);
  }
  return text;
}

Canvas accuracy_plot(const std::vector<SweepRow>& rows, const std::string& machine) {
  constexpr double kWidth = 1260, kHeight = 470, kPanel = 340, kGap = 70;
  Canvas canvas(kWidth, kHeight);
  for (std::size_t i = 0; i < panels().size(); ++i)
    draw_panel(canvas, {60 + static_cast<double>(i) * (kPanel + kGap), 40, kPanel, 330}, rows, panels()[i]);
  std::vector<LegendEntry> legend;
  const std::vector<std::string> scenes = scene_names(rows);
  for (std::size_t i = 0; i < scenes.size(); ++i) legend.push_back({scenes[i], style_of(i)});
  CurveStyle dashed = style_of(0, engine::Visibility::zbuffer);
  dashed.colour = kPaleInk, dashed.marker = Marker::none;
  legend.push_back({"by z-buffer", dashed});
  draw_legend(canvas, {60 + kPanel - 6, 46}, legend);
  TextStyle note;
  note.colour = kPaleInk;
  canvas.text({60, kHeight - 28},
              "Lines: Pareto front of each scene and way to see (pale: settings that another one beats). Left to "
              "right: max_error_px from "
              "coarse to fine; for radiance also samples per pixel. On the lower edge: no measurable error.",
              note);
  canvas.text({60, kHeight - 12}, "Measured on " + machine + ".", note);
  return canvas;
}

}  // namespace selenograph::api
