#include "engine/visibility/zbuffer/sun_disc.h"

#include <algorithm>
#include <bit>
#include <cmath>

#include "dem/parallel.h"
#include "engine/support/pool.h"

namespace selenograph::engine {
namespace {

// Of the spiral of directions: its first point and the last eight, which are around the rim (successive points of
// Vogel's spiral are 137.5 degrees apart: the largest gap between eight of them is 53).
constexpr int kRim = 8;
constexpr std::uint32_t kScouts = 1U | ((1U << kRim) - 1U) << (kDiscSamples - kRim);
constexpr int kMargin_px = 2;  // around what is in doubt: a penumbra narrower than a pixel may show in one of two
static_assert(kDiscSamples == 32, "a bit for each");

// All pixels within the margin of one that is in doubt, by rows and then by columns.
void widen(int width, int height, const std::vector<std::uint8_t>& doubt, std::vector<std::uint8_t>& along_rows,
           std::vector<std::uint8_t>& out) {
  const auto w = static_cast<std::size_t>(width);
  along_rows.assign(doubt.size(), 0), out.assign(doubt.size(), 0);
  in_parallel(static_cast<std::size_t>(height), [&](std::size_t y) {
    for (int x = 0; x < width; ++x) {
      if (!doubt[y * w + static_cast<std::size_t>(x)]) continue;
      for (int to = std::max(0, x - kMargin_px); to <= std::min(width - 1, x + kMargin_px); ++to)
        along_rows[y * w + static_cast<std::size_t>(to)] = 1;
    }
  });
  in_parallel(static_cast<std::size_t>(height), [&](std::size_t y) {
    const std::size_t from = y < kMargin_px ? 0 : y - kMargin_px,
                      to = std::min(static_cast<std::size_t>(height) - 1, y + kMargin_px);
    for (std::size_t row = from; row <= to; ++row)
      for (std::size_t x = 0; x < w; ++x) out[y * w + x] |= along_rows[row * w + x];
  });
}

}  // namespace

std::size_t DiscScratch::bytes() const {
  std::size_t sum = bytes_of(dark) + bytes_of(doubt) + bytes_of(along_rows) + bytes_of(around);
  for (const auto* list : {&turned, &doubtful})
    for (const LightSamples& s : *list) sum += s.bytes();
  return sum;
}

SunDisc::SunDisc(const Sun& sun) : directions_(disc_directions(sun)) {}

void SunDisc::faced_by(const SurfacePoints& points, std::int32_t faces[kPacket]) const {
  std::uint32_t bits[kPacket] = {};
  for (int k = 0; k < kDiscSamples; ++k) {
    std::int32_t facing[kPacket];
    facing_sun(points, directions_[static_cast<std::size_t>(k)], facing);
    for (int i = 0; i < kPacket; ++i) bits[i] |= static_cast<std::uint32_t>(facing[i]) << k;
  }
  for (int i = 0; i < kPacket; ++i) faces[i] = static_cast<std::int32_t>(bits[i]);
}

float SunDisc::lit_share(std::uint32_t faces, std::uint8_t dark) {
  return static_cast<float>(std::popcount(faces) - dark) / kDiscSamples;
}

void SunDisc::cast(const RasterMesh& mesh, const ShadowMap& middle, int width, int height,
                   const std::vector<LightSamples>& samples, LightScratch& light, DiscScratch& scratch,
                   const StopToken& stop) const {
  const std::size_t pixels = static_cast<std::size_t>(width) * static_cast<std::size_t>(height);
  scratch.dark.assign(pixels, 0);
  const auto look = [&](const std::vector<LightSamples>& from, int k) {
    const ShadowMap map(mesh, directions_[static_cast<std::size_t>(k)]);
    scratch.turned.resize(from.size());
    in_parallel(from.size(), [&](std::size_t i) { map.turn(middle, from[i], 1U << k, scratch.turned[i]); });
    map.cast(scratch.turned, light, stop);
    in_parallel(light.shadowed.size(), [&](std::size_t band) {
      for (const std::uint32_t at : light.shadowed[band]) ++scratch.dark[at];
    });
  };
  for (int k = 0; k < kDiscSamples; ++k)
    if (kScouts >> k & 1) look(samples, k);

  std::vector<std::uint8_t>& first = scratch.doubt;
  first.assign(pixels, 0);
  in_parallel(samples.size(), [&](std::size_t i) {
    const LightSamples& tile = samples[i];
    for (std::size_t k = 0; k < tile.count; ++k) {
      const std::uint32_t at = tile.pixel[k], faces = tile.faces[k];
      const bool whole = faces == ~0U, all_dark = scratch.dark[at] == std::popcount(kScouts);
      first[at] = !(whole && (scratch.dark[at] == 0 || all_dark));
    }
  });
  std::vector<std::uint8_t>& doubt = scratch.around;
  widen(width, height, first, scratch.along_rows, doubt);
  scratch.doubtful.resize(samples.size());
  in_parallel(samples.size(), [&](std::size_t i) {
    const LightSamples& tile = samples[i];
    LightSamples& out = scratch.doubtful[i];
    out.clear(tile.count, true);
    for (std::size_t k = 0; k < tile.count; ++k) {
      const std::uint32_t at = tile.pixel[k];
      if (doubt[at]) {
        out.add_face(static_cast<std::int32_t>(tile.faces[k]));
        out.add(tile.u[k], tile.v[k], tile.d[k], at);
      } else if (scratch.dark[at] > 0) {
        scratch.dark[at] = kDiscSamples;
      }
    }
  });
  for (int k = 0; k < kDiscSamples; ++k)
    if (!(kScouts >> k & 1)) look(scratch.doubtful, k);
}

}  // namespace selenograph::engine
