// Metadata of a frame.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "engine/frame/light_times.h"
#include "engine/frame/request.h"

namespace selenograph::engine {

// A DEM tile used in the frame; the product `source` holds indices into the list of these.
struct SourceTile {
  std::string name;
  std::string path;
  std::uint64_t version = 0;  // hash of path, size and modification time
};

// Components of at-sensor radiance, SENSOR++ eq. (1), integrated over the frame's band: the values that all pixels of a
// frame share.
struct RadianceTerms {
  double direct_w_m2 = 0;  // E_sun tau of eq. (2); L_dir is this times mu0 f_r s
  // Further components of eq. (1), W m-2 sr-1, added wherever a surface is hit, sunlit or not. Empty: not requested.
  std::optional<double> indirect, scattered, emitted, thermal_path;

  double base_w_m2_sr() const {
    return indirect.value_or(0) + scattered.value_or(0) + emitted.value_or(0) + thermal_path.value_or(0);
  }
  // Names of the evaluated components, "direct" first.
  std::vector<std::string_view> names() const;
};

struct StageTimes {
  double select_ms = 0;  // selection of blocks: level of detail, occluders
  double build_ms = 0;   // mesh and acceleration structure; 0 if the scene was cached
  // Parts of select_ms and build_ms: time waiting for pyramid chunks to be read or built; time waiting for blocks to be
  // loaded, including their pyramid chunks.
  double pyramid_ms = 0, load_ms = 0;
  double indirect_ms = 0;    // light from terrain and Earth at posts; 0 without
  LightTimes light{};        // parts of indirect_ms
  double visibility_ms = 0;  // visible points, refinement, light and shading
  // Parts of visibility_ms with the z-buffer: drawing triangles, refining and shading points, casting shadows. Ray
  // tracing has no separate parts.
  double draw_ms = 0, resolve_ms = 0, shadow_ms = 0;
  double sensor_ms = 0;   // exposure plan, sky, image
  double craters_ms = 0;  // list of craters; 0 without

  // Returns the sum of the stages, without their parts.
  double sum_ms() const { return select_ms + build_ms + indirect_ms + visibility_ms + sensor_ms + craters_ms; }

  StageTimes& operator+=(const StageTimes& t) {
    select_ms += t.select_ms;
    build_ms += t.build_ms;
    pyramid_ms += t.pyramid_ms;
    load_ms += t.load_ms;
    indirect_ms += t.indirect_ms;
    light += t.light;
    visibility_ms += t.visibility_ms;
    draw_ms += t.draw_ms;
    resolve_ms += t.resolve_ms;
    shadow_ms += t.shadow_ms;
    sensor_ms += t.sensor_ms;
    craters_ms += t.craters_ms;
    return *this;
  }
};

// Geometry of the view on the ground. Members are empty where the line of sight hits no terrain, or hits an object
// first; those of the boresight also if it is outside the image.
struct ViewReport {
  std::optional<Geographic> boresight;               // intersection of the boresight with the terrain
  std::array<std::optional<Geographic>, 4> corners;  // corner pixels, clockwise from the upper left
  double off_nadir_deg = 0;                          // angle between the boresight and the Moon's centre
  // At the boresight's intersection with the terrain: compass azimuth of the image's up direction, azimuth and
  // elevation of the Sun over the datum's horizon, and the post spacing of the DEM there in pixels.
  std::optional<double> up_azimuth_deg, sun_azimuth_deg, sun_elevation_deg, post_px;
  std::optional<std::array<double, 2>> phase_deg;  // smallest and largest phase angle over the image, sky included
};

struct FrameReport {
  Visibility visibility = Visibility::raytrace;  // algorithm used
  double lod_error_px = 0, lod_error_m = 0;      // upper bounds of the mesh's error in view
  double detail_error_px = 0;                    // share of lod_error_px that comes from detail
  // 99th percentile of the mesh's error over the pixels, as expected.
  double expected_error_px = 0, expected_error_m = 0;
  double detail_limit_px = 0;  // max_detail_error_px as used (see Accuracy); 0: no detail
  double shadow_error_px = 0;  // upper bound for shadow edges on level ground; 0 without Sun
  // Accuracy::max_shadow_error_px as used for the frame and then for the exposure's further samples. Larger than
  // requested if that much terrain does not fit into the memory for scenes.
  std::vector<double> shadow_limits_px;
  double min_post_spacing_m = 0, max_post_spacing_m = 0;
  std::size_t triangles = 0;
  std::size_t scene_bytes = 0;  // mesh and acceleration structure
  double filled_fraction = 0;   // share of all pixels on posts filled by interpolation
  double blended_fraction = 0;  // share of all pixels on posts that are bent to meet a finer layer
  // Share of all pixels without data: the ray hits only the datum or, where the scene has ground below it, the sphere
  // through the lowest ground.
  double missing_fraction = 0;
  double hit_fraction = 0, object_fraction = 0;  // shares of all pixels: surface of any kind; objects
  double rock_fraction = 0;                      // share of all pixels on rocks
  std::size_t rocks = 0;                         // rocks in view, or with a shadow that may be in view
  double least_rock_px = 0;                      // diameter of the smallest rocks shown; 0: no rocks
  RadianceTerms radiance;                        // for the terrain, in frames with radiance or image
  double ground_view = 0;                        // TerrainLight::max_ground_view(); 0 without light from terrain
  bool emits_elsewhere = false;                  // an object emits, or the ground does by a temperature map
  double full_scale_radiance_w_m2_sr = 0;        // full scale of `image`; 0 without image
  double integration_time_s = 0;                 // 0 without a sensor
  int motion_samples = 0;                        // exposure samples; 0 without motion
  double longest_streak_px = 0;                  // longest motion streak, approximately
  double saturated_fraction = 0;                 // share of `image`'s pixels that are saturated
  double smear_fill = 0;                         // share of a pixel's capacity that is filled by smear alone
  bool lit = false;                              // radiance above 0 somewhere, in frames with radiance or image
  double brightest_signal_e = 0;                 // light's electrons in the brightest pixel; 0 without a sensor
  int margin_px = 0;              // pixels rendered around the image for the point spread; included in shares of pixels
  double captured_fraction = 1;   // share of a point's light within the point-spread kernel
  double scattered_fraction = 0;  // share of all light that the optics scatter
  double glare_w_m2_sr = 0;       // largest radiance that the Sun scatters into the image from outside
  ViewReport view;
  CraterRims craters;  // if requested
  std::vector<SourceTile> sources;
  std::vector<std::string> warnings;  // e.g. a corrupt tile replaced by the layer below
};

}  // namespace selenograph::engine
