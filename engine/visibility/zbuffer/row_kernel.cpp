#include "engine/visibility/zbuffer/row_kernel.h"

#include <algorithm>
#include <cmath>

#include "dem/base/vector_targets.h"
#include "engine/camera/packet_rays.h"
#include "engine/visibility/points/facets.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "engine/visibility/zbuffer/row_kernel.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

#ifndef SELENOGRAPH_ENGINE_ROW_POINTS
#define SELENOGRAPH_ENGINE_ROW_POINTS
namespace selenograph::engine {

// Barycentric width of the edge of a triangle: more than kEdge of pixel_kernels.h by the rounding of float.
constexpr float kRowEdge = 1.2e-5F;

// The geometry of sixteen points, all but the phase angle rounded to float.
struct alignas(64) RowPoints {
  double ray2[kPacket], ray_to_sun[kPacket];    // products of the ray with itself and the Sun's direction
  float v[kPacket], w[kPacket];                 // weights of the second and third vertex
  float inside[kPacket];                        // the least of the three weights
  float above[kPacket];                         // positive if the ray meets the triangle from above
  float facing[kPacket];                        // positive if the triangle faces the Sun
  float dx[kPacket], dy[kPacket], dz[kPacket];  // the ray's direction
  float mu0[kPacket], mu[kPacket];              // cosines of incidence and emission
};

}  // namespace selenograph::engine
#endif

HWY_BEFORE_NAMESPACE();
namespace selenograph::engine::HWY_NAMESPACE {

// Intersects the rays with their triangles, by the equations in row_kernel.h, and places the points in light space.
// (ax, ay, az) is the vector from the eye to corner a, b and c are the edges e1 and e2, n is the normal.
void FindRowPoints(const RowTerms& terms, const Facets& facets, double x, double y, RowPoints& points,
                   ResolvedRow& out) {
  SELENOGRAPH_INDEPENDENT_LANES
  for (int i = 0; i < kPacket; ++i) {
    const double px = x + i;
    const double dx = terms.first[0] + terms.right[0] * px + terms.down[0] * y;
    const double dy = terms.first[1] + terms.right[1] * px + terms.down[1] * y;
    const double dz = terms.first[2] + terms.right[2] * px + terms.down[2] * y;
    const double ax = facets.a[0][i] - terms.eye[0], ay = facets.a[1][i] - terms.eye[1],
                 az = facets.a[2][i] - terms.eye[2];
    const double bx = facets.b[0][i] - facets.a[0][i], by = facets.b[1][i] - facets.a[1][i],
                 bz = facets.b[2][i] - facets.a[2][i];
    const double cx = facets.c[0][i] - facets.a[0][i], cy = facets.c[1][i] - facets.a[1][i],
                 cz = facets.c[2][i] - facets.a[2][i];
    const double nx = by * cz - bz * cy, ny = bz * cx - bx * cz, nz = bx * cy - by * cx;
    const double ray_to_normal = nx * dx + ny * dy + nz * dz;
    const double inverse = 1 / ray_to_normal;
    const double distance = (nx * ax + ny * ay + nz * az) * inverse;
    const double v = (dx * (cy * az - cz * ay) + dy * (cz * ax - cx * az) + dz * (cx * ay - cy * ax)) * inverse;
    const double w = (dx * (ay * bz - az * by) + dy * (az * bx - ax * bz) + dz * (ax * by - ay * bx)) * inverse;
    const double u = 1 - v - w;
    const double min_vw = v < w ? v : w;
    const double inside = min_vw < u ? min_vw : u;
    const double ray_to_sun = terms.axis[2][0] * dx + terms.axis[2][1] * dy + terms.axis[2][2] * dz;
    points.ray2[i] = dx * dx + dy * dy + dz * dz;
    points.ray_to_sun[i] = ray_to_sun;
    points.v[i] = static_cast<float>(v);
    points.w[i] = static_cast<float>(w);
    points.inside[i] = static_cast<float>(inside);
    points.above[i] = static_cast<float>(ray_to_normal < 0 ? distance : -1);
    points.facing[i] = static_cast<float>(terms.axis[2][0] * nx + terms.axis[2][1] * ny + terms.axis[2][2] * nz);
    points.dx[i] = static_cast<float>(dx);
    points.dy[i] = static_cast<float>(dy);
    points.dz[i] = static_cast<float>(dz);
    out.light.u[i] = static_cast<float>(
        terms.from_eye[0] + distance * (terms.axis[0][0] * dx + terms.axis[0][1] * dy + terms.axis[0][2] * dz));
    out.light.v[i] = static_cast<float>(
        terms.from_eye[1] + distance * (terms.axis[1][0] * dx + terms.axis[1][1] * dy + terms.axis[1][2] * dz));
    out.light.d[i] = static_cast<float>(terms.from_eye[2] + distance * ray_to_sun);
  }
}

// Shades the points: interpolates the normal, and evaluates the reflectance with closed terms. Sets the lanes that are
// resolved, and those of them that are lit. (ax, ay, az) is the normal of vertex a, n the interpolated one. `albedo`:
// factors of the reflectance.
void ShadeRow(const RowTerms& terms, RowPoints& points, const Facets& facets, const float* albedo, ResolvedRow& out) {
  const float sx = terms.sun[0];
  const float sy = terms.sun[1];
  const float sz = terms.sun[2];
  const float centre_d_m = terms.centre_d_m;
  const float lommel_seeliger = terms.lommel_seeliger;
  const float lambert = terms.lambert;
  const float base = terms.base;
  std::uint32_t all_resolved = 0, lit = 0;
  SELENOGRAPH_INDEPENDENT_LANES
  for (int i = 0; i < kPacket; ++i) {
    const float v = points.v[i], w = points.w[i];
    const float ax = facets.normal_a[0][i], ay = facets.normal_a[1][i], az = facets.normal_a[2][i];
    const float nx = ax + v * (facets.normal_b[0][i] - ax) + w * (facets.normal_c[0][i] - ax);
    const float ny = ay + v * (facets.normal_b[1][i] - ay) + w * (facets.normal_c[1][i] - ay);
    const float nz = az + v * (facets.normal_b[2][i] - az) + w * (facets.normal_c[2][i] - az);
    const float dx = points.dx[i], dy = points.dy[i], dz = points.dz[i];
    const float normal_to_ray = nx * dx + ny * dy + nz * dz;
    const float normal_to_sun = nx * sx + ny * sy + nz * sz;
    const float inverse_length = 1 / std::sqrt(nx * nx + ny * ny + nz * nz);
    const float mu0 = normal_to_sun * inverse_length;
    const float mu = -normal_to_ray * inverse_length / std::sqrt(dx * dx + dy * dy + dz * dz);
    const float white = lommel_seeliger * (mu0 / (mu0 + mu)) + lambert * mu0;  // eqs. (2), (4) and (10)
    const float radiance = white * albedo[i];
    points.mu0[i] = mu0;
    points.mu[i] = mu;
    const bool faces_sun = (normal_to_sun > 0) & (points.facing[i] > 0);
    const bool resolved = (points.inside[i] > kRowEdge) & (points.above[i] > 0) & (normal_to_ray < 0) &
                          (!(points.facing[i] > 0) | (out.light.d[i] > centre_d_m));
    out.radiance[i] = (faces_sun ? radiance : 0.F) + base;
    lit |= faces_sun ? 1U << i : 0U;
    all_resolved |= resolved ? 1U << i : 0U;
  }
  out.lit = lit & all_resolved;  // combined here: GCC 12 would not vectorize the loop
  out.resolved = all_resolved;
}

// Implements place_row().
void PlaceRow(const RowTerms& terms, double x, double y, const LightLanes& light, RowPlaces& out) {
  SELENOGRAPH_INDEPENDENT_LANES
  for (int i = 0; i < kPacket; ++i) {
    const double px = x + i;
    out.dx[i] = terms.first[0] + terms.right[0] * px + terms.down[0] * y;
    out.dy[i] = terms.first[1] + terms.right[1] * px + terms.down[1] * y;
    out.dz[i] = terms.first[2] + terms.right[2] * px + terms.down[2] * y;
    const double u = static_cast<double>(light.u[i]) - terms.from_eye[0],
                 v = static_cast<double>(light.v[i]) - terms.from_eye[1],
                 d = static_cast<double>(light.d[i]) - terms.from_eye[2];
    out.x[i] = terms.eye[0] + u * terms.axis[0][0] + v * terms.axis[1][0] + d * terms.axis[2][0];
    out.y[i] = terms.eye[1] + u * terms.axis[0][1] + v * terms.axis[1][1] + d * terms.axis[2][1];
    out.z[i] = terms.eye[2] + u * terms.axis[0][2] + v * terms.axis[1][2] + d * terms.axis[2][2];
  }
}

// Computes the cosines of the shaded points; that of the phase angle from double, which the opposition surge needs: the
// angle of a float near 1 is off by 0.02 degrees.
void RowCosines(const RowPoints& p, double* mu0, double* mu, double* cos_phase) {
  SELENOGRAPH_INDEPENDENT_LANES
  for (int i = 0; i < kPacket; ++i) {
    mu0[i] = static_cast<double>(p.mu0[i]);
    mu[i] = static_cast<double>(p.mu[i]);
    cos_phase[i] = -p.ray_to_sun[i] / std::sqrt(p.ray2[i]);
  }
}

}  // namespace selenograph::engine::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace selenograph::engine {

HWY_EXPORT(FindRowPoints);
HWY_EXPORT(ShadeRow);
HWY_EXPORT(RowCosines);
HWY_EXPORT(PlaceRow);

namespace {

// Factors of a reflectance that has its albedo. They are constant: written for each row, they would stall its loop,
// which reads them in wider vectors.
alignas(64) constexpr float kOnes[kPacket] = {1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1};

// Sets the albedos of points, whose weights are known: factors of the reflectance, or w of Hapke.
void find_albedos(const VertexBrightness& vertices, const Albedo& albedo, const RowPoints& points, float* out) {
  interpolate_brightness(vertices, points.v, points.w, out);
  const auto constant = static_cast<float>(albedo.constant), largest = static_cast<float>(albedo.largest);
  for (int i = 0; i < kPacket; ++i) out[i] = std::min(constant * out[i], largest);
}

// Sets the radiance of a reflectance without closed terms.
void reflect_row(const RowTerms& terms, const RowPoints& points, const float* factors, ResolvedRow& out) {
  alignas(64) double mu0[kPacket];
  alignas(64) double mu[kPacket];
  alignas(64) double cos_phase[kPacket];
  alignas(64) double mu0_brdf[kPacket];
  HWY_DYNAMIC_DISPATCH(RowCosines)(points, mu0, mu, cos_phase);
  alignas(64) double albedo[kPacket];
  std::copy_n(factors, kPacket, albedo);
  const bool replaces_w = terms.albedo && terms.albedo->is_w;
  terms.other_brdf->times_mu0(mu0, mu, cos_phase, replaces_w ? albedo : nullptr, mu0_brdf);
  for (int i = 0; i < kPacket; ++i) {
    const double reflected = replaces_w ? mu0_brdf[i] : mu0_brdf[i] * albedo[i];
    out.radiance[i] = (out.lit >> i & 1 ? static_cast<float>(terms.irradiance_w_m2 * reflected) : 0.F) + terms.base;
  }
}

}  // namespace

// Light space has its origin at the anchor, so the Moon's centre, the origin of MOON_ME, lies at -anchor.
RowTerms::RowTerms(const View& view, const Vec3& anchor, const std::array<Vec3, 3>& axes, const Brdf& brdf,
                   double sunlight_w_m2, float base_w_m2_sr, const std::optional<Albedo>& missing_albedo)
    : centre_d_m(static_cast<float>(-axes[2].dot(anchor))),
      base(base_w_m2_sr),
      other_brdf(brdf.terms() ? nullptr : &brdf),
      irradiance_w_m2(sunlight_w_m2),
      albedo(missing_albedo) {
  const BrdfTerms closed = brdf.terms() ? *brdf.terms() : BrdfTerms();
  lommel_seeliger = static_cast<float>(irradiance_w_m2 * closed.lommel_seeliger);
  lambert = static_cast<float>(irradiance_w_m2 * closed.lambert);
  const LinearRays rays(view);
  for (int k = 0; k < 3; ++k) {
    first[k] = rays.first[k];
    right[k] = rays.right[k];
    down[k] = rays.down[k];
    eye[k] = view.position()[k];
    for (int e = 0; e < 3; ++e) axis[k][e] = axes[k][e];
    from_eye[k] = axes[k].dot(view.position() - anchor);
    sun[k] = static_cast<float>(axes[2][k]);
  }
}

void resolve_row(const Mesh& mesh, const RowTerms& terms, double x, double y, const TriangleId* triangles,
                 ResolvedRow& out) {
  Facets facets;
  gather(mesh, triangles, facets);
  // Gather brightness before the rays are intersected: vectors that read what scalar code has just stored would stall.
  VertexBrightness brightness;
  if (terms.albedo) gather_brightness(mesh, triangles, brightness);
  RowPoints points;
  HWY_DYNAMIC_DISPATCH(FindRowPoints)(terms, facets, x, y, points, out);
  alignas(64) float albedo[kPacket];
  if (terms.albedo) find_albedos(brightness, *terms.albedo, points, albedo);
  const float* factors = terms.albedo ? albedo : kOnes;
  HWY_DYNAMIC_DISPATCH(ShadeRow)(terms, points, facets, factors, out);
  if (terms.other_brdf && out.resolved) reflect_row(terms, points, factors, out);
}

void place_row(const RowTerms& terms, double x, double y, const LightLanes& light, RowPlaces& out) {
  HWY_DYNAMIC_DISPATCH(PlaceRow)(terms, x, y, light, out);
}

}  // namespace selenograph::engine
#endif  // HWY_ONCE
