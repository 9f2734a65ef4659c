#include "dem/grid/shading_normals.h"

#include <algorithm>

#include "dem/grid/normal_kernels.h"

namespace selenograph::dem {
namespace {

struct Slope {
  double along_row = 0, along_column = 0;  // m per post
};

// Returns the slopes of the least-squares plane through the valid posts of a (2 reach + 1)^2 window; 0 if these lie on
// a line. Solves the normal equations of the centred sums (cxx = sum of (x - mean x)^2 ..) by Cramer's rule.
Slope fit_plane(const float* centre, int stride, int reach) {
  double sx = 0, sy = 0, n = 0, sxx = 0, syy = 0, sxh = 0, syh = 0;
  const double origin = static_cast<double>(*centre);
  double sh = 0, sxy = 0;
  for (int y = -reach; y <= reach; ++y)
    for (int x = -reach; x <= reach; ++x) {
      const double h = static_cast<double>(centre[y * stride + x]) - origin;
      if (std::isnan(h)) continue;
      n += 1;
      sx += x;
      sy += y;
      sxx += x * x;
      syy += y * y;
      sxy += x * y;
      sh += h;
      sxh += x * h;
      syh += y * h;
    }
  const double cxx = sxx - sx * sx / n, cyy = syy - sy * sy / n, cxy = sxy - sx * sy / n;
  const double cxh = sxh - sx * sh / n, cyh = syh - sy * sh / n;
  const double det = cxx * cyy - cxy * cxy;
  if (!(det > 1e-9)) return {};
  return {(cxh * cyy - cyh * cxy) / det, (cyh * cxx - cxh * cxy) / det};
}

// Returns the slope at a post that may have voids around it.
Slope slope_at(const float* centre, int stride, SlopeStencil stencil) {
  if (stencil == SlopeStencil::plane_5) return fit_plane(centre, stride, 2);
  if (stencil == SlopeStencil::sharpened) {
    const Slope slope{sharpened_slope(centre, 1), sharpened_slope(centre, stride)};
    if (!std::isnan(slope.along_row + slope.along_column)) return slope;
  }
  return fit_plane(centre, stride, 1);
}

// Returns the stencil for posts `spacing_m` apart.
SlopeStencil stencil_for(const HeightsKind& kind, double spacing_m) {
  if (kind.filtered) return SlopeStencil::sharpened;
  // Rounding to steps of q is noise with a standard deviation of q / sqrt(12). The slope of a 3 x 3 plane divides it by
  // sqrt(6) post spacings.
  const double noise = kind.quantisation_m / std::sqrt(12.0) / (std::sqrt(6.0) * spacing_m);
  return noise > kQuantisationSlope ? SlopeStencil::plane_5 : SlopeStencil::plane_3;
}

}  // namespace

void fill_shading_normals(Block& block, std::span<const float> heights, const HeightsKind& kind) {
  const int side = block.side(), stride = side + 2 * kHalo;
  const SlopeStencil stencil = stencil_for(kind, post_spacing_m(block.id.level));
  const double base_radius_m = kMoonRadius_m + kind.base_m;
  const double radians_per_tick = kRadiansPerDegree / kTicksPerDegree;
  // Spacing of posts, radians.
  const double dlat = block.extent.lat_step * radians_per_tick, dlon = block.extent.lon_step * radians_per_tick;
  const bool has_no_voids = std::none_of(heights.begin(), heights.end(), [](float h) { return std::isnan(h); });
  std::vector<float> row_normals(3 * static_cast<std::size_t>(side));  // structure of arrays
  float *x = row_normals.data(), *y = x + side, *z = y + side;
  for (int r = 0; r < side; ++r) {
    const auto row = static_cast<std::size_t>(r);
    const double cos_lat = block.cos_lat[row], sin_lat = block.sin_lat[row];
    const float* centres = heights.data() + (r + kHalo) * stride + kHalo;
    const bool pole = cos_lat <= 1e-9;  // without an eastward direction: use the vertical
    if (has_no_voids && !pole) {
      normals_of_row(centres, stride, side, stencil,
                     {cos_lat, sin_lat, block.cos_lon.data(), block.sin_lon.data(), dlat, dlon, base_radius_m}, x, y,
                     z);
      for (int c = 0; c < side; ++c) block.vertices[block.index(r, c)].normal = {x[c], y[c], z[c]};
      continue;
    }
    for (int c = 0; c < side; ++c) {
      const auto col = static_cast<std::size_t>(c);
      const float* centre = centres + c;
      const double cos_lon = block.cos_lon[col], sin_lon = block.sin_lon[col];
      const Vec3 up(cos_lat * cos_lon, cos_lat * sin_lon, sin_lat), east(-sin_lon, cos_lon, 0);
      const Vec3 north(-sin_lat * cos_lon, -sin_lat * sin_lon, cos_lat);
      Vec3 normal = up;
      if (!pole && !std::isnan(*centre)) {
        const Slope s = slope_at(centre, stride, stencil);
        const double radius = base_radius_m + static_cast<double>(*centre);
        normal = (up - east * (s.along_row / (radius * cos_lat * dlon)) - north * (s.along_column / (radius * dlat)))
                     .normalized();
      }
      block.vertices[block.index(r, c)].normal = normal.cast<float>();
    }
  }
}

}  // namespace selenograph::dem
