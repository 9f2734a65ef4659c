// Resolves sixteen pixels of a drawn row in one pass: the exact point, its place in light space and its radiance.
//
// This is the short way of nearly all pixels of a plain frame: terrain of one reflectance in the light of a point Sun,
// seen by a camera without distortion. With the eye at the origin, corner a, edges e1 and e2 of the triangle, its
// normal n = e1 x e2 and the ray d, one division gives distance and weights:
//
//   t = n.a / n.d,   v = d.(e2 x a) / n.d,   w = d.(a x e1) / n.d.
//
// Distance, weights and light space are double; the normal and the radiance are float and differ from those of
// PacketShader by 3e-7 of the brightest pixel. All other pixels are resolved by RasterPass.
#pragma once

#include <array>
#include <cstdint>
#include <optional>

#include "engine/camera/view.h"
#include "engine/radiometry/brdf.h"
#include "engine/radiometry/mapped_surface.h"
#include "engine/scene/mesh.h"
#include "engine/support/packet.h"
#include "engine/visibility/zbuffer/shadow_map.h"

namespace selenograph::engine {

// Camera, Sun and reflectance of a frame, as plain numbers, which the loop over lanes keeps in registers.
struct RowTerms {
  // `axes`: of light space (ShadowMap), the last one toward the Sun. sunlight_w_m2: on a plane that faces the Sun.
  // base_w_m2_sr: radiance without the Sun. `brdf` must outlive this object. `missing_albedo`: of the reflectance,
  // before the brightness of made ground; empty: the reflectance is the same everywhere.
  RowTerms(const View& view, const Vec3& anchor, const std::array<Vec3, 3>& axes, const Brdf& brdf,
           double sunlight_w_m2, float base_w_m2_sr, const std::optional<Albedo>& missing_albedo = {});

  double first[3], right[3], down[3], eye[3];  // ray of pixel (0, 0), its change per pixel, the eye; MOON_ME, m
  double axis[3][3], from_eye[3];              // axes of light space, and the eye in it
  float sun[3];                                // toward the Sun
  float centre_d_m;                            // light-space d of the Moon's centre: below it is the night side
  float lommel_seeliger, lambert;              // BrdfTerms times irradiance; W m-2 sr-1
  float base;                                  // radiance without the Sun, W m-2 sr-1
  const Brdf* other_brdf;                      // a reflectance that is no sum of these two terms; else null
  double irradiance_w_m2;
  std::optional<Albedo> albedo;  // missing_albedo
};

struct ResolvedRow {
  alignas(64) float radiance[kPacket];  // W m-2 sr-1, eq. (1), as if nothing hid the Sun
  LightLanes light;                     // the points in light space, without rest_*
  std::uint32_t resolved = 0;           // lanes whose values are set, one bit each
  std::uint32_t lit = 0;                // those of them that face the Sun
};

// Resolves the pixels from (x, y) on, in pixels of the image. `triangles`: one for each pixel. A pixel is resolved if
// its ray meets its triangle from above and not at an edge (kRowEdge), if its shading normal faces the camera, and if
// the interior of the Moon does not hide the Sun. That and its values depend on no other pixel of the row.
void resolve_row(const Mesh& mesh, const RowTerms& terms, double x, double y, const TriangleId* triangles,
                 ResolvedRow& out);

// Rays and points of sixteen pixels, MOON_ME, m. The points follow from their places in light space and are rounded as
// these are.
struct alignas(64) RowPlaces {
  double dx[kPacket], dy[kPacket], dz[kPacket];  // directions of the rays
  double x[kPacket], y[kPacket], z[kPacket];
};
void place_row(const RowTerms& terms, double x, double y, const LightLanes& light, RowPlaces& out);

}  // namespace selenograph::engine
