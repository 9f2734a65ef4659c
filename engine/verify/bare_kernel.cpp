#include "engine/verify/bare_kernel.h"

#include <algorithm>
#include <cmath>

#include "dem/base/parallel.h"

namespace selenograph::engine {

BareKernel::BareKernel(const Mesh& mesh, const Vec3& anchor_m, int threads)
    : scene_(mesh.blocks().size(), threads, EmbreeScene::Filters::none), anchor_(anchor_m) {
  for (std::size_t i = 0; i < mesh.blocks().size(); ++i) {
    const MeshBlock& block = mesh.blocks()[i];
    const int side = block.posts->side();
    scene_.set_grid(i, side, [&](std::span<float> vertices) {
      float* v = vertices.data();
      for (int r = 0; r < side; ++r)
        for (int c = 0; c < side; ++c)
          for (int k = 0; k < 3; ++k) *v++ = static_cast<float>((block.vertex(r, c) - anchor_)[k]);
    });
  }
  scene_.build();
}

void BareKernel::render(const View& view, const Vec3& sun, double shell_radius_m, std::vector<float>& image) const {
  const Camera& camera = view.camera();
  const int width = camera.width, height = camera.height;
  image.resize(static_cast<std::size_t>(width) * static_cast<std::size_t>(height));
  const Mat3f m = view.moon_from_camera().cast<float>();
  // Start all rays half way to the plane where the boresight enters the shell: a single distance for all rays costs
  // nothing per ray.
  const double above = std::max(0.0, view.position().norm() - shell_radius_m);
  const Vec3 boresight = view.moon_from_camera().col(2);
  const double descent = -boresight.dot(view.position().normalized());
  const float skip = descent > 0.2 ? static_cast<float>(above / descent * 0.5) : 0.F;
  const Vec3f o = (view.position() - anchor_).cast<float>(), s = sun.cast<float>();
  constexpr int kTile = 32;
  const int across = width / kTile, along = height / kTile;
  in_parallel(static_cast<std::size_t>(across * along), [&](std::size_t index) {
    const int tile = static_cast<int>(index);
    for (int by = 0; by < kTile; by += 4)
      for (int bx = 0; bx < kTile; bx += 4) {
        const int x0 = tile % across * kTile + bx, y0 = tile / across * kTile + by;
        // Primary rays of 4 x 4 pixels.
        RayPacket rays;
        for (int i = 0; i < kPacket; ++i) {
          const float x =
              (static_cast<float>(x0 + (i & 3)) - static_cast<float>(camera.cx)) / static_cast<float>(camera.fx);
          const float y =
              (static_cast<float>(y0 + (i >> 2)) - static_cast<float>(camera.cy)) / static_cast<float>(camera.fy);
          rays.active[i] = -1;
          for (int k = 0; k < 3; ++k)
            (k == 0 ? rays.dx : k == 1 ? rays.dy : rays.dz)[i] = m(k, 0) * x + m(k, 1) * y + m(k, 2);
          rays.ox[i] = o.x() + skip * rays.dx[i];
          rays.oy[i] = o.y() + skip * rays.dy[i];
          rays.oz[i] = o.z() + skip * rays.dz[i];
        }
        RayHits hits;
        scene_.intersect(rays, hits, EmbreeScene::Bundles::always);
        // Shadow rays from their hits, moved toward the Sun by a constant bias.
        RayPacket shadow;
        constexpr float kBias = 0.05F;
        for (int i = 0; i < kPacket; ++i) {
          shadow.active[i] = hits.geometry[i] != RayHits::kNone ? -1 : 0;
          const float t = shadow.active[i] ? hits.distance[i] : 0;
          shadow.ox[i] = rays.ox[i] + t * rays.dx[i] + kBias * s.x();
          shadow.oy[i] = rays.oy[i] + t * rays.dy[i] + kBias * s.y();
          shadow.oz[i] = rays.oz[i] + t * rays.dz[i] + kBias * s.z();
          shadow.dx[i] = s.x();
          shadow.dy[i] = s.y();
          shadow.dz[i] = s.z();
          shadow.near[i] = kBias;
        }
        bool blocked[kPacket];
        scene_.occluded(shadow, blocked, {}, EmbreeScene::Bundles::always);
        for (int i = 0; i < kPacket; ++i) {
          const float nx = hits.nx[i], ny = hits.ny[i], nz = hits.nz[i],
                      inv = 1 / std::sqrt(nx * nx + ny * ny + nz * nz);
          const float mu0 = (nx * s.x() + ny * s.y() + nz * s.z()) * inv;
          const float mu = -(nx * rays.dx[i] + ny * rays.dy[i] + nz * rays.dz[i]) * inv;
          const bool lit = shadow.active[i] && !blocked[i] && mu0 > 0;
          image[static_cast<std::size_t>(y0 + (i >> 2)) * static_cast<std::size_t>(width) +
                static_cast<std::size_t>(x0 + (i & 3))] = lit ? mu0 / (mu0 + mu) : 0.F;
        }
      }
  });
}

}  // namespace selenograph::engine
