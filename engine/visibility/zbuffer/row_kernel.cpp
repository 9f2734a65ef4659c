#include "engine/visibility/zbuffer/row_kernel.h"

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

// Intersects the rays with their triangles and places the points in light space.
void FindRowPoints(const RowTerms& g, const Facets& t, double x, double y, RowPoints& points, ResolvedRow& out) {
  SELENOGRAPH_INDEPENDENT_LANES
  for (int i = 0; i < kPacket; ++i) {
    const double px = x + i;
    const double dx = g.first[0] + g.right[0] * px + g.down[0] * y;
    const double dy = g.first[1] + g.right[1] * px + g.down[1] * y;
    const double dz = g.first[2] + g.right[2] * px + g.down[2] * y;
    const double ax = t.a[0][i] - g.eye[0], ay = t.a[1][i] - g.eye[1], az = t.a[2][i] - g.eye[2];
    const double bx = t.b[0][i] - t.a[0][i], by = t.b[1][i] - t.a[1][i], bz = t.b[2][i] - t.a[2][i];
    const double cx = t.c[0][i] - t.a[0][i], cy = t.c[1][i] - t.a[1][i], cz = t.c[2][i] - t.a[2][i];
    const double nx = by * cz - bz * cy, ny = bz * cx - bx * cz, nz = bx * cy - by * cx;
    const double toward = nx * dx + ny * dy + nz * dz;
    const double per_toward = 1 / toward;
    const double distance = (nx * ax + ny * ay + nz * az) * per_toward;
    const double v = (dx * (cy * az - cz * ay) + dy * (cz * ax - cx * az) + dz * (cx * ay - cy * ax)) * per_toward;
    const double w = (dx * (ay * bz - az * by) + dy * (az * bx - ax * bz) + dz * (ax * by - ay * bx)) * per_toward;
    const double u = 1 - v - w;
    const double lower = v < w ? v : w;
    const double inside = lower < u ? lower : u;
    const double along = g.axis[2][0] * dx + g.axis[2][1] * dy + g.axis[2][2] * dz;
    points.ray2[i] = dx * dx + dy * dy + dz * dz;
    points.ray_to_sun[i] = along;
    points.v[i] = static_cast<float>(v);
    points.w[i] = static_cast<float>(w);
    points.inside[i] = static_cast<float>(inside);
    points.above[i] = static_cast<float>(toward < 0 ? distance : -1);
    points.facing[i] = static_cast<float>(g.axis[2][0] * nx + g.axis[2][1] * ny + g.axis[2][2] * nz);
    points.dx[i] = static_cast<float>(dx);
    points.dy[i] = static_cast<float>(dy);
    points.dz[i] = static_cast<float>(dz);
    out.light.u[i] =
        static_cast<float>(g.from_eye[0] + distance * (g.axis[0][0] * dx + g.axis[0][1] * dy + g.axis[0][2] * dz));
    out.light.v[i] =
        static_cast<float>(g.from_eye[1] + distance * (g.axis[1][0] * dx + g.axis[1][1] * dy + g.axis[1][2] * dz));
    out.light.d[i] = static_cast<float>(g.from_eye[2] + distance * along);
  }
}

// Shades the points.
void ShadeRow(const RowTerms& terms, RowPoints& p, const Facets& t, ResolvedRow& out) {
  const float sx = terms.sun[0];
  const float sy = terms.sun[1];
  const float sz = terms.sun[2];
  const float horizon_m = terms.horizon_m;
  const float lommel_seeliger = terms.lommel_seeliger;
  const float lambert = terms.lambert;
  const float base = terms.base;
  std::uint32_t all_resolved = 0, lit = 0;
  SELENOGRAPH_INDEPENDENT_LANES
  for (int i = 0; i < kPacket; ++i) {
    const float v = p.v[i], w = p.w[i];
    const float ax = t.normal_a[0][i], ay = t.normal_a[1][i], az = t.normal_a[2][i];
    const float nx = ax + v * (t.normal_b[0][i] - ax) + w * (t.normal_c[0][i] - ax);
    const float ny = ay + v * (t.normal_b[1][i] - ay) + w * (t.normal_c[1][i] - ay);
    const float nz = az + v * (t.normal_b[2][i] - az) + w * (t.normal_c[2][i] - az);
    const float dx = p.dx[i], dy = p.dy[i], dz = p.dz[i];
    const float along = nx * dx + ny * dy + nz * dz;
    const float toward = nx * sx + ny * sy + nz * sz;
    const float per_normal = 1 / std::sqrt(nx * nx + ny * ny + nz * nz);
    const float mu0 = toward * per_normal;
    const float mu = -along * per_normal / std::sqrt(dx * dx + dy * dy + dz * dz);
    const float radiance = lommel_seeliger * (mu0 / (mu0 + mu)) + lambert * mu0;  // eqs. (2), (4) and (10)
    p.mu0[i] = mu0;
    p.mu[i] = mu;
    const bool faces_sun = (toward > 0) & (p.facing[i] > 0);
    const bool resolved =
        (p.inside[i] > kRowEdge) & (p.above[i] > 0) & (along < 0) & (!(p.facing[i] > 0) | (out.light.d[i] > horizon_m));
    out.radiance[i] = (faces_sun ? radiance : 0.F) + base;
    lit |= faces_sun ? 1U << i : 0U;
    all_resolved |= resolved ? 1U << i : 0U;
  }
  out.lit = lit & all_resolved;  // combined here: GCC 12 would not vectorize the loop
  out.resolved = all_resolved;
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

namespace {

// Sets the radiance of a reflectance without closed terms.
void reflect_row(const RowTerms& terms, const RowPoints& points, ResolvedRow& out) {
  alignas(64) double mu0[kPacket];
  alignas(64) double mu[kPacket];
  alignas(64) double cos_phase[kPacket];
  alignas(64) double mu0_brdf[kPacket];
  HWY_DYNAMIC_DISPATCH(RowCosines)(points, mu0, mu, cos_phase);
  terms.open_brdf->times_mu0(mu0, mu, cos_phase, nullptr, mu0_brdf);
  for (int i = 0; i < kPacket; ++i)
    out.radiance[i] = (out.lit >> i & 1 ? static_cast<float>(terms.irradiance_w_m2 * mu0_brdf[i]) : 0.F) + terms.base;
}

}  // namespace

RowTerms::RowTerms(const View& view, const Vec3& anchor, const std::array<Vec3, 3>& axes, const Brdf& brdf,
                   double sunlight_w_m2, float base_w_m2_sr)
    : horizon_m(static_cast<float>(-axes[2].dot(anchor))),
      base(base_w_m2_sr),
      open_brdf(brdf.terms() ? nullptr : &brdf),
      irradiance_w_m2(sunlight_w_m2) {
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
  RowPoints points;
  HWY_DYNAMIC_DISPATCH(FindRowPoints)(terms, facets, x, y, points, out);
  HWY_DYNAMIC_DISPATCH(ShadeRow)(terms, points, facets, out);
  if (terms.open_brdf && out.resolved) reflect_row(terms, points, out);
}

}  // namespace selenograph::engine
#endif  // HWY_ONCE
