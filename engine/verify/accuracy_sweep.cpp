#include "engine/verify/accuracy_sweep.h"

#include <tbb/task_arena.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <limits>
#include <memory>

#include "dem/base/error.h"
#include "dem/base/parallel.h"
#include "dem/base/quantile.h"
#include "engine/scene/anchor.h"
#include "engine/scene/selection.h"
#include "engine/verify/bare_kernel.h"
#include "engine/visibility/points/scene.h"

namespace selenograph::engine {
namespace {

using Clock = std::chrono::steady_clock;

// Returns the wall time of work().
template <typename Work>
double milliseconds(const Work& work) {
  const auto start = Clock::now();
  work();
  return std::chrono::duration<double, std::milli>(Clock::now() - start).count();
}

// Target for shadows of the reference: the finest posts of all occluders may not fit. Much less than the errors of
// edges to be measured.
constexpr double kReferenceShadowError_px = 0.25;

// Target of the reference over ground with detail, whose finest posts may be a millimetre apart.
constexpr double kReferenceDetailError_px = 1.0 / 16;

struct Setting {
  Accuracy accuracy;
  Visibility visibility;
};

// Measures the Embree baseline of one frame, on the finest mesh.
class EmbreeBaseline {
 public:
  EmbreeBaseline(const Renderer& renderer, const FrameRequest& request, const Accuracy& setting)
      : arena_(renderer.threads()), view_(request.camera, request.pose), sun_(request.sun.direction) {
    const auto terrain = renderer.terrain_with(request.detail);
    const Selection finest = select_for_view(*terrain, view_, &request.sun, setting, {});
    const Mesh mesh(*terrain, finest.blocks);
    shell_m_ = kMoonRadius_m + Scene::highest_m(mesh) + 1;
    kernel_ = std::make_unique<BareKernel>(mesh, anchor_for(view_.position(), view_.middle()), renderer.threads());
  }

  // Returns the time of one frame.
  double ms() {
    return milliseconds([&] {
      in_arena(arena_, [&] {
        kernel_->render(view_, sun_, shell_m_, image_);
        return 0;
      });
    });
  }

 private:
  tbb::task_arena arena_;
  View view_;
  Vec3 sun_;
  double shell_m_ = 0;
  std::unique_ptr<BareKernel> kernel_;
  std::vector<float> image_;
};

// Measures one frame's contribution to the row of each setting.
class FrameSweep {
 public:
  FrameSweep(const Renderer& renderer, const FrameRequest& request, const SweepOptions& options)
      : renderer_(renderer),
        request_(request),
        options_(options),
        terrain_(renderer.terrain_with(request.detail)),
        view_(request.camera, request.pose) {}

  // Renders the reference: the finest posts, or what kReferenceDetailError_px asks for, and many samples for radiance.
  // Relaxes the target until its terrain fits.
  void prepare() {
    Accuracy setting{0, options_.reference_samples, kReferenceShadowError_px};
    double target_px = request_.detail ? kReferenceDetailError_px : 0;
    for (;; target_px = target_px > 0 ? 2 * target_px : 1.0 / 64) {
      setting.max_error_px = target_px;
      if (request_.detail) setting.max_detail_error_px = target_px;
      try {
        Frame reference = frame({setting, Visibility::raytrace}, kRadiance | kLit);
        reference_ = std::move(reference.products);
        reference_max_error_px_ = target_px;
        if (request_.detail) {
          // The reference's mesh: what was asked for may have a hundred times as many triangles.
          setting.max_detail_error_px = reference_max_error_px_ = reference.report.detail_limit_px;
          setting.max_shadow_error_px = reference.report.shadow_limits_px.front();
        }
        baseline_ = std::make_unique<EmbreeBaseline>(renderer_, request_, setting);
        return;
      } catch (const TooMuchTerrain&) {
        if (target_px >= 4) throw;
      }
    }
  }

  // Throws TooMuchTerrain if the setting's terrain does not fit.
  void measure(const Setting& setting, SweepRow& row, ErrorCollector& errors) {
    Frame measured = frame(setting, kRadiance | kLit | kPosition | (request_.detail ? ProductSet{kRock} : 0) |
                                        (request_.objects.empty() ? 0 : ProductSet{kObjectId}));
    const FrameReport& report = measured.report;
    // Exclude rocks and objects from the geometric errors, which are measured against the terrain.
    FrameProducts& products = measured.products;
    const auto exclude = [&](std::size_t i) {
      std::fill_n(&products.position[3 * i], 3, std::numeric_limits<double>::quiet_NaN());
    };
    for (std::size_t i = 0; i < products.rock.size(); ++i)
      if (products.rock[i] < measured.rocks.size()) exclude(i);
    for (std::size_t i = 0; i < products.object_id.size(); ++i)
      if (products.object_id[i] < request_.objects.size()) exclude(i);
    if (request_.detail) {
      const auto width = static_cast<std::size_t>(request_.camera.width);
      const std::size_t step = step_of_points();
      for (std::size_t i = 0; i < products.position.size() / 3; ++i)
        if (i % width % step != 0 || i / width % step != 0) exclude(i);
    }
    errors.add_geometry(view_, *terrain_, measured.products.position, report);
    errors.add_shadows(request_.camera.width, request_.camera.height, measured.products.lit, reference_.lit);
    errors.add_radiance(measured.products.radiance, reference_.radiance);
    row.reference_max_error_px = std::max(row.reference_max_error_px, reference_max_error_px_);
    row.triangles = std::max(row.triangles, report.triangles);
    row.scene_bytes = std::max(row.scene_bytes, report.scene_bytes);
    row.bound_px = std::max(row.bound_px, report.lod_error_px);
    row.bound_m = std::max(row.bound_m, report.lod_error_m);
    row.expected_px = std::max(row.expected_px, report.expected_error_px);
    row.shadow_bound_px = std::max(row.shadow_bound_px, report.shadow_error_px);
    time(setting, row);
  }

 private:
  Frame frame(const Setting& setting, ProductSet products) const {
    FrameRequest request = request_;
    request.accuracy = setting.accuracy;
    request.visibility = setting.visibility;
    request.products = products;
    return renderer_.render(request);
  }

  // Returns the columns and rows between points that are compared with ground with detail. Each point needs ground of
  // its own, which takes a millisecond to make.
  std::size_t step_of_points() const {
    constexpr double kMaxPoints = 16384;
    const double pixels = static_cast<double>(request_.camera.width) * request_.camera.height;
    return static_cast<std::size_t>(std::ceil(std::sqrt(std::max(pixels / kMaxPoints, 1.0))));
  }

  // Measures our frame and the baseline alternately, so that other load on the machine affects both.
  void time(const Setting& setting, SweepRow& row) {
    std::vector<double> ours, bare;
    frame(setting, kRadiance);
    for (int i = 0; i < options_.repetitions; ++i) {
      bare.push_back(baseline_->ms());
      ours.push_back(milliseconds([&] { frame(setting, kRadiance); }));
    }
    row.frame_ms += median(ours);
    row.bare_ms += median(bare);
  }

  const Renderer& renderer_;
  const FrameRequest& request_;
  const SweepOptions& options_;
  std::shared_ptr<const dem::Terrain> terrain_;
  View view_;
  FrameProducts reference_;
  double reference_max_error_px_ = 0;
  std::unique_ptr<EmbreeBaseline> baseline_;
};

// Measures a setting; returns false if its terrain does not fit.
bool try_measure(FrameSweep& frame, const Setting& setting, SweepRow& row, ErrorCollector& errors) {
  try {
    frame.measure(setting, row, errors);
    return true;
  } catch (const TooMuchTerrain&) {
    return false;
  }
}

bool has_detail(const AccuracyScene& scene) { return scene.frames.front().detail != nullptr; }

// Returns the settings to measure. Each varies one quantity or a pair of them; all others have their defaults.
std::vector<Setting> settings_of(const SweepOptions& options, const AccuracyScene& scene) {
  std::vector<Setting> settings;
  for (const Visibility method : options.methods) {
    for (const double error : options.max_errors_px)
      for (const int samples : options.samples_per_pixel)
        settings.push_back({{.max_error_px = error, .samples_per_pixel = samples}, method});
    for (const double shadows : options.max_shadow_errors_px)
      settings.push_back({{.max_shadow_error_px = shadows}, method});
    if (has_detail(scene))
      for (const double detail : options.max_detail_errors_px)
        settings.push_back(
            {{.max_error_px = std::min(Accuracy{}.max_error_px, detail), .max_detail_error_px = detail}, method});
    const auto is_own = [&](const Setting& s) { return s.visibility == method && s.accuracy == scene.own; };
    if (scene.own && std::ranges::none_of(settings, is_own)) settings.push_back({*scene.own, method});
  }
  return settings;
}

// Returns the number of measurements, including one reference per frame.
std::size_t steps_of(const std::vector<AccuracyScene>& scenes, const SweepOptions& options) {
  std::size_t steps = 0;
  for (const AccuracyScene& s : scenes) steps += s.frames.size() * (settings_of(options, s).size() + 1);
  return steps;
}

}  // namespace

std::vector<SweepRow> sweep(const Renderer& renderer, const std::vector<AccuracyScene>& scenes,
                            const SweepOptions& options, const SweepProgress& progress) {
  const std::size_t total = steps_of(scenes, options);
  std::vector<SweepRow> rows;
  std::size_t done = 0;
  for (const AccuracyScene& scene : scenes) {
    const std::vector<Setting> settings = settings_of(options, scene);
    std::vector<SweepRow> scene_rows;
    std::vector<ErrorCollector> errors(settings.size());
    std::vector<char> fits(settings.size(), 1);
    for (const Setting& setting : settings) {
      SweepRow& row = scene_rows.emplace_back();
      row.scene = scene.name;
      row.setting = setting.accuracy;
      row.visibility = setting.visibility;
      row.with_detail = has_detail(scene);
    }
    for (const FrameRequest& request : scene.frames) {
      FrameSweep frame(renderer, request, options);
      progress(done++, total, scene.name + ": reference");
      frame.prepare();
      for (std::size_t i = 0; i < settings.size(); ++i) {
        progress(done++, total, scene.name);
        if (fits[i]) fits[i] = try_measure(frame, settings[i], scene_rows[i], errors[i]);
      }
    }
    for (std::size_t i = 0; i < settings.size(); ++i) {
      if (!fits[i]) continue;
      scene_rows[i].errors = errors[i].result();
      rows.push_back(scene_rows[i]);
    }
  }
  progress(total, total, "done");
  return rows;
}

}  // namespace selenograph::engine
