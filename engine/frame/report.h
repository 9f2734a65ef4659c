// What is said about a frame besides its pixels.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "engine/frame/request.h"

namespace selenograph::engine {

// A DEM tile that the frame stands on; `source` indexes the list of these.
struct SourceTile {
  std::string name;
  std::string path;
  std::uint64_t version = 0;  // hash of path, size and modification time
};

// At-sensor radiance is the sum of its components, SENSOR++ eq. (1): what all pixels of a frame share of them,
// integrated over its band.
struct RadianceTerms {
  double direct_w_m2 = 0;  // E_sun tau of eq. (2): times mu0 f_r s is L_dir
  // The others of eq. (1), W m-2 sr-1: of whatever is hit, in the Sun or not. Empty: not asked for.
  std::optional<double> indirect, scattered, emitted, thermal_path;

  double base_w_m2_sr() const {
    return indirect.value_or(0) + scattered.value_or(0) + emitted.value_or(0) + thermal_path.value_or(0);
  }
  // "direct" and those that were evaluated.
  std::vector<std::string_view> names() const;
};

struct StageTimes {
  double select_ms = 0;  // level of detail, casters
  double build_ms = 0;   // mesh and acceleration structure; 0 when the scene was warm
  // Of those two: waiting for parts of the pyramid to be read or made; for blocks to be loaded, with what that waited
  // for the pyramid.
  double pyramid_ms = 0, load_ms = 0;
  double visibility_ms = 0;  // what each pixel sees, refined, lit and shaded
  // Of that, by z-buffer: drawing triangles, refining and shading points, casting shadows. Rays do all at once.
  double draw_ms = 0, resolve_ms = 0, shadow_ms = 0;
  double sensor_ms = 0;

  StageTimes& operator+=(const StageTimes& t) {
    select_ms += t.select_ms, build_ms += t.build_ms, pyramid_ms += t.pyramid_ms, load_ms += t.load_ms;
    visibility_ms += t.visibility_ms, draw_ms += t.draw_ms, resolve_ms += t.resolve_ms, shadow_ms += t.shadow_ms;
    sensor_ms += t.sensor_ms;
    return *this;
  }
};

// What a view is, in words of the ground. Empty where the line of sight meets no terrain, or an object before it, and
// of the boresight where it is outside the image.
struct ViewReport {
  std::optional<Geographic> boresight;               // where it meets the terrain
  std::array<std::optional<Geographic>, 4> corners;  // of the corner pixels: upper left and on, clockwise
  double off_nadir_deg = 0;                          // between the boresight and the Moon's centre
  // Where the boresight meets the terrain: the compass azimuth of what is up in the image, the Sun's azimuth and
  // elevation above the sphere's horizon, and how many pixels wide the post spacing of the DEM is that is seen there.
  std::optional<double> up_azimuth_deg, sun_azimuth_deg, sun_elevation_deg, post_px;
};

struct FrameReport {
  Visibility visibility = Visibility::raytrace;  // that the frame was made with
  double lod_error_px = 0, lod_error_m = 0;      // bounds on the mesh's error in view
  double detail_error_px = 0;                    // of that, what a detail adds
  double detail_limit_px = 0;  // Accuracy::max_detail_error_px or what it gave way to; 0: there is no detail
  double shadow_error_px = 0;  // bound on the displacement of shadow edges on level ground; 0 without Sun
  // Accuracy::max_shadow_error_px as it was used: of the frame, then of the exposure's other moments. More than what
  // was asked where that much terrain does not fit into the memory for scenes.
  std::vector<double> shadow_limits_px;
  double min_post_spacing_m = 0, max_post_spacing_m = 0;
  std::size_t triangles = 0;
  std::size_t scene_bytes = 0;                   // of the mesh and its acceleration structure
  double filled_fraction = 0;                    // of all pixels: on posts that were filled by interpolation
  double blended_fraction = 0;                   // of all pixels: on posts that are a mean of two layers
  double missing_fraction = 0;                   // of all pixels: look at the Moon where there is no data
  double hit_fraction = 0, object_fraction = 0;  // of all pixels: see anything; see an object
  double rock_fraction = 0;                      // of all pixels: see a rock
  std::size_t rocks = 0;                         // in view, or whose shadow may be
  double least_rock_px = 0;                      // diameter from which on they are shown; 0: the detail has none
  RadianceTerms radiance;                        // of the terrain in frames with radiance or image
  bool emits_elsewhere = false;                  // an object's material does, or the ground by a map of temperatures
  double full_scale_radiance_w_m2_sr = 0;        // that `image` was made with; 0 without image
  double integration_time_s = 0;                 // of a sensor; 0 without
  int motion_samples = 0;                        // moments of the exposure; 0 without motion
  double longest_streak_px = 0;                  // that a point on the ground or an object may draw meanwhile: about
  double saturated_fraction = 0;                 // of `image`: pixels that are full, or as bright as it goes
  double smear_fill = 0;                         // of a sensor: what smear alone takes of what a pixel holds
  double brightest_w_m2_sr = 0;                  // of frames with radiance or image
  int margin_px = 0;             // rendered around the image for what spreads into it; shares of pixels count it
  double captured_fraction = 1;  // of a point's light, within the point spread's kernel
  ViewReport view;
  std::vector<SourceTile> sources;
  std::vector<std::string> warnings;  // e.g. a corrupt tile replaced by the layer below
};

}  // namespace selenograph::engine
