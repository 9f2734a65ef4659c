#include "engine/verify/bare_kernel.h"

#include <embree3/rtcore.h>
#include <fmt/format.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <limits>

namespace selenograph::engine {

struct BareKernel::Native {
  explicit Native(int threads)
      : device(rtcNewDevice(fmt::format("threads={}", threads).c_str())), scene(rtcNewScene(device)) {}
  ~Native() {
    rtcReleaseScene(scene);
    rtcReleaseDevice(device);
  }
  RTCDevice device;
  RTCScene scene;
};

BareKernel::BareKernel(const Mesh& mesh, const Vec3& anchor_m, int threads)
    : native_(std::make_unique<Native>(threads)), anchor_(anchor_m) {
  RTCDevice device = native_->device;
  RTCScene scene = native_->scene;
  rtcSetSceneFlags(scene, RTC_SCENE_FLAG_ROBUST);
  for (const MeshBlock& block : mesh.blocks()) {
    const int side = block.posts->side();
    const auto count = static_cast<std::size_t>(side) * static_cast<std::size_t>(side);
    RTCGeometry geometry = rtcNewGeometry(device, RTC_GEOMETRY_TYPE_GRID);
    auto* v =
        static_cast<float*>(rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT3, 12, count));
    auto* grid = static_cast<RTCGrid*>(
        rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_GRID, 0, RTC_FORMAT_GRID, sizeof(RTCGrid), 1));
    *grid = {0, static_cast<unsigned>(side), static_cast<std::uint16_t>(side), static_cast<std::uint16_t>(side)};
    for (int r = 0; r < side; ++r)
      for (int c = 0; c < side; ++c)
        for (int k = 0; k < 3; ++k) *v++ = static_cast<float>((block.vertex(r, c) - anchor_)[k]);
    rtcCommitGeometry(geometry);
    rtcAttachGeometry(scene, geometry);
    rtcReleaseGeometry(geometry);
  }
  rtcCommitScene(scene);
}

BareKernel::~BareKernel() = default;

void BareKernel::render(const View& view, const Vec3& sun, double shell_radius_m, std::vector<float>& image) const {
  const Camera& camera = view.camera();
  const int width = camera.width, height = camera.height;
  image.resize(static_cast<std::size_t>(width) * static_cast<std::size_t>(height));
  const Eigen::Matrix3f m = view.moon_from_camera().cast<float>();
  // The frame's rays start where the boresight enters the shell's tangent plane: one plane for all keeps this kernel
  // bare.
  const double above = std::max(0.0, view.position().norm() - shell_radius_m);
  const Vec3 boresight = view.moon_from_camera().col(2);
  const double descent = -boresight.dot(view.position().normalized());
  const float skip = descent > 0.2 ? static_cast<float>(above / descent * 0.5) : 0.F;
  const Eigen::Vector3f o = (view.position() - anchor_).cast<float>(), s = sun.cast<float>();
  RTCScene scene = native_->scene;
  constexpr int kTile = 32;
  const int across = width / kTile, along = height / kTile;
  tbb::parallel_for(0, across * along, [&](int tile) {
    RTCIntersectContext context;
    rtcInitIntersectContext(&context);
    context.flags = RTC_INTERSECT_CONTEXT_FLAG_COHERENT;
    for (int by = 0; by < kTile; by += 4)
      for (int bx = 0; bx < kTile; bx += 4) {
        const int x0 = tile % across * kTile + bx, y0 = tile / across * kTile + by;
        RTCRayHit16 rh;
        alignas(64) int valid[16];
        for (int i = 0; i < 16; ++i) {
          const float x =
              (static_cast<float>(x0 + (i & 3)) - static_cast<float>(camera.cx)) / static_cast<float>(camera.fx);
          const float y =
              (static_cast<float>(y0 + (i >> 2)) - static_cast<float>(camera.cy)) / static_cast<float>(camera.fy);
          valid[i] = -1;
          for (int k = 0; k < 3; ++k)
            (k == 0 ? rh.ray.dir_x : k == 1 ? rh.ray.dir_y : rh.ray.dir_z)[i] = m(k, 0) * x + m(k, 1) * y + m(k, 2);
          rh.ray.org_x[i] = o.x() + skip * rh.ray.dir_x[i], rh.ray.org_y[i] = o.y() + skip * rh.ray.dir_y[i],
          rh.ray.org_z[i] = o.z() + skip * rh.ray.dir_z[i];
          rh.ray.tnear[i] = 0, rh.ray.tfar[i] = std::numeric_limits<float>::infinity(), rh.ray.mask[i] = ~0U,
          rh.ray.time[i] = 0, rh.ray.flags[i] = 0;
          rh.hit.geomID[i] = rh.hit.instID[0][i] = RTC_INVALID_GEOMETRY_ID;
        }
        rtcIntersect16(valid, scene, &context, &rh);
        RTCRay16 shadow;
        constexpr float kBias = 0.05F;
        for (int i = 0; i < 16; ++i) {
          valid[i] = rh.hit.geomID[i] != RTC_INVALID_GEOMETRY_ID ? -1 : 0;
          const float t = valid[i] ? rh.ray.tfar[i] : 0;
          shadow.org_x[i] = rh.ray.org_x[i] + t * rh.ray.dir_x[i] + kBias * s.x(),
          shadow.org_y[i] = rh.ray.org_y[i] + t * rh.ray.dir_y[i] + kBias * s.y();
          shadow.org_z[i] = rh.ray.org_z[i] + t * rh.ray.dir_z[i] + kBias * s.z();
          shadow.dir_x[i] = s.x(), shadow.dir_y[i] = s.y(), shadow.dir_z[i] = s.z();
          shadow.tnear[i] = kBias, shadow.tfar[i] = std::numeric_limits<float>::infinity(), shadow.mask[i] = ~0U,
          shadow.time[i] = 0, shadow.flags[i] = 0;
        }
        rtcOccluded16(valid, scene, &context, &shadow);
        for (int i = 0; i < 16; ++i) {
          const float nx = rh.hit.Ng_x[i], ny = rh.hit.Ng_y[i], nz = rh.hit.Ng_z[i],
                      inv = 1 / std::sqrt(nx * nx + ny * ny + nz * nz);
          const float mu0 = (nx * s.x() + ny * s.y() + nz * s.z()) * inv;
          const float mu = -(nx * rh.ray.dir_x[i] + ny * rh.ray.dir_y[i] + nz * rh.ray.dir_z[i]) * inv;
          const bool lit = valid[i] && shadow.tfar[i] > 0 && mu0 > 0;
          image[static_cast<std::size_t>(y0 + (i >> 2)) * static_cast<std::size_t>(width) +
                static_cast<std::size_t>(x0 + (i & 3))] = lit ? mu0 / (mu0 + mu) : 0.F;
        }
      }
  });
}

}  // namespace selenograph::engine
