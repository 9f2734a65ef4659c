#include "engine/indirect/slope_light.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <utility>

#include "dem/support/parallel.h"

namespace selenograph::engine {
namespace {

constexpr double kPi = std::numbers::pi;

// The share of a disc above a chord, at `x` radii above its middle.
double share_above(double x) {
  if (x >= 1) return 0;
  if (x <= -1) return 1;
  return 0.5 - (std::asin(x) + x * std::sqrt(1 - x * x)) / kPi;
}

// Turns the lanes to an azimuth of the grids.
void aim(float ux, float uy, MarchLanes& lanes, AzimuthLanes& out) {
  for (int i = 0; i < kPacket; ++i) {
    lanes.ux[i] = ux, lanes.uy[i] = uy;
    const float dot = ux * out.up[0][i] + uy * out.up[1][i];
    const float x = ux - dot * out.up[0][i], y = uy - dot * out.up[1][i], z = -dot * out.up[2][i];
    const float length = 1 / std::sqrt(x * x + y * y + z * z);
    out.along[0][i] = x * length, out.along[1][i] = y * length, out.along[2][i] = z * length;
  }
}

}  // namespace

SkyDisc::SkyDisc(const Relief& relief, const Vec3& direction, double angular_radius_deg)
    : direction_(relief.axes() * direction),
      radius_(angular_radius_deg * kRadiansPerDegree),
      sphere_(relief.sphere()) {}

void SkyDisc::shares(std::span<const GridView> grids, MarchLanes& lanes, float* share) const {
  alignas(64) float enough[kPacket], horizon[kPacket];
  double tangent[kPacket], cosine[kPacket];
  for (int i = 0; i < kPacket; ++i) {
    const Vec3 plane(static_cast<double>(lanes.x[i]), static_cast<double>(lanes.y[i]), kMoonRadius_m);
    // Where the great circle to the source goes.
    const double ux = direction_.x() - plane.x() * direction_.z() / kMoonRadius_m,
                 uy = direction_.y() - plane.y() * direction_.z() / kMoonRadius_m;
    const double length = std::hypot(ux, uy), sine = plane.normalized().dot(direction_);
    lanes.ux[i] = length > 1e-12 ? static_cast<float>(ux / length) : 1;
    lanes.uy[i] = length > 1e-12 ? static_cast<float>(uy / length) : 0;
    cosine[i] = std::sqrt(std::max(1 - sine * sine, 1e-12)), tangent[i] = sine / cosine[i];
    // What hides all of it. Of a lane without a height, nothing need be known.
    enough[i] = static_cast<float>(std::tan(std::min(std::asin(std::clamp(sine, -1.0, 1.0)) + radius_, 1.57)));
    if (std::isnan(lanes.height[i])) enough[i] = -std::numeric_limits<float>::infinity();
  }
  find_horizons(grids, sphere_, lanes, enough, horizon);
  for (int i = 0; i < kPacket; ++i) {
    const double above = static_cast<double>(horizon[i]) - tangent[i];
    share[i] = std::isnan(lanes.height[i]) ? 0
               : radius_ > 0               ? static_cast<float>(share_above(above * cosine[i] * cosine[i] / radius_))
                                           : (above > 0 ? 0.F : 1.F);
  }
}

void find_shares(const Relief& relief, const SkyDisc& disc, std::span<const Vec3> places, std::span<float> out,
                 const StopToken& stop) {
  const std::vector<GridView> grids = relief.views();
  in_parallel_pieces((places.size() + kPacket - 1) / kPacket, 16, [&](std::size_t first, std::size_t past_last) {
    stop.check();
    for (std::size_t p = first; p < past_last; ++p) {
      const std::size_t at = p * kPacket, count = std::min<std::size_t>(kPacket, places.size() - at);
      MarchLanes lanes = relief.places(places.subspan(at, count));
      alignas(64) float share[kPacket];
      disc.shares(grids, lanes, share);
      std::copy_n(share, count, out.begin() + static_cast<std::ptrdiff_t>(at));
    }
  });
}

SlopeLight::SlopeLight(const Relief& relief, SlopeLightSource source, const StopToken& stop)
    : relief_(relief),
      source_(std::move(source)),
      disc_(relief, source_.sun.direction, source_.sun.angular_radius_deg),
      grids_(relief.views()) {
  constexpr std::size_t kPiece = 64 * kPacket;
  for (std::size_t g = 0; g < relief.grids(); ++g) {
    const std::size_t cells = static_cast<std::size_t>(relief.side(g)) * static_cast<std::size_t>(relief.side(g));
    light_.emplace_back(cells);
    in_parallel_pieces((cells + kPiece - 1) / kPiece, 1, [&](std::size_t first, std::size_t past_last) {
      stop.check();
      light_cells(g, first * kPiece, std::min(cells, past_last * kPiece));
    });
    grids_[g].light = light_[g].data();
  }
}

// The grid's own heights and those of the coarser ones shade it.
void SlopeLight::light_cells(std::size_t grid, std::size_t first, std::size_t past_last) {
  const GridView& view = grids_[grid];
  const std::span<const GridView> around = std::span(grids_).subspan(grid);
  const double lowest = -std::sin(source_.sun.angular_radius_deg * kRadiansPerDegree);
  std::vector<Vec3> directions;
  std::vector<float> albedo(past_last - first, 1.F);
  if (source_.albedo) {
    for (std::size_t i = first; i < past_last; ++i) directions.push_back(relief_.direction(grid, i, true));
    source_.albedo(static_cast<double>(view.spacing_m), directions, albedo);
  }
  for (std::size_t at = first; at < past_last; at += kPacket) {
    const std::size_t count = std::min<std::size_t>(kPacket, past_last - at);
    MarchLanes lanes;
    Relief::Cell cells[kPacket];
    alignas(64) float share[kPacket];
    for (std::size_t i = 0; i < kPacket; ++i) {
      const std::size_t post = at + std::min(i, count - 1), side = static_cast<std::size_t>(view.side);
      cells[i] = relief_.cell(grid, post);
      lanes.x[i] = view.first_m + (static_cast<float>(post % side) + 0.5F) * view.spacing_m;
      lanes.y[i] = view.first_m + (static_cast<float>(post / side) + 0.5F) * view.spacing_m;
      // What is turned away needs no march.
      const bool faces = cells[i].normal.cast<double>().dot(disc_.direction()) > lowest;
      lanes.height[i] = faces ? cells[i].height : std::nanf("");
    }
    disc_.shares(around, lanes, share);
    for (std::size_t i = 0; i < count; ++i)
      light_[grid][at + i] = {cells[i].normal.x(), cells[i].normal.y(), share[i], albedo[at + i - first]};
  }
}

void SlopeLight::radiosities(std::span<const Vec3> places, std::span<float> out) const {
  for (std::size_t i = 0; i < places.size(); ++i) {
    const std::size_t post = relief_.post_beneath(relief_.places(places.subspan(i, 1)), 0);
    const GroundLight& ground = light_.front()[post];
    const Eigen::Vector3d normal = relief_.cell(0, post).normal.cast<double>();
    const double mu0 = normal.dot(disc_.direction());
    const auto factor = static_cast<double>(ground.lit * (source_.albedo_is_w ? 1 : ground.albedo));
    out[i] = mu0 > 0 && factor > 0 ? static_cast<float>(kPi * factor * source_.irradiance_w_m2 *
                                                        source_.brdf.times_mu0(mu0, normal.z(), disc_.direction().z()))
                                   : 0;
  }
}

void SlopeLight::gather(std::span<const Vec3> places, std::span<SectorLight> out, const StopToken& stop) const {
  const std::size_t packets = (places.size() + kPacket - 1) / kPacket;
  in_parallel_pieces(packets, 4, [&](std::size_t first, std::size_t past_last) {
    std::vector<SeenPiece> pieces;
    for (std::size_t p = first; p < past_last; ++p) {
      stop.check();
      const std::size_t at = p * kPacket, count = std::min<std::size_t>(kPacket, places.size() - at);
      gather_sixteen(places.subspan(at, count), out.subspan(at, count), pieces);
    }
  });
}

void SlopeLight::gather_sixteen(std::span<const Vec3> places, std::span<SectorLight> out,
                                std::vector<SeenPiece>& pieces) const {
  MarchLanes lanes = relief_.places(places);
  alignas(64) float sums[kSectors][3][kPacket] = {};
  AzimuthLanes azimuths;
  for (int k = 0; k < 3; ++k) azimuths.sun[k] = static_cast<float>(disc_.direction()[k]);
  for (std::size_t i = 0; i < kPacket; ++i) {
    const Vec3 d = relief_.axes() * places[std::min(i, places.size() - 1)];
    for (int k = 0; k < 3; ++k) azimuths.up[k][i] = static_cast<float>(d[k]);
  }
  constexpr float kAzimuth = static_cast<float>(2 * kPi / kAzimuths);
  PieceLight light;
  alignas(64) double reflected[kPacket];
  for (int azimuth = 0; azimuth < kAzimuths; ++azimuth) {
    const double phi = (azimuth + 0.5) * 2 * kPi / kAzimuths;
    aim(static_cast<float>(std::cos(phi)), static_cast<float>(std::sin(phi)), lanes, azimuths);
    pieces.clear();
    find_pieces(grids_, relief_.sphere(), lanes, pieces);
    auto& sum = sums[azimuth / (kAzimuths / kSectors)];
    for (const SeenPiece& piece : pieces) {
      if (!light_piece(piece, azimuths, light)) continue;
      source_.brdf.times_mu0(light.mu0, light.mu, light.cos_phase, source_.albedo_is_w ? light.albedo : nullptr,
                             reflected);
      add_piece(piece, azimuths, light, reflected, !source_.albedo_is_w, sum);
    }
  }
  const auto scale = static_cast<float>(source_.irradiance_w_m2) * kAzimuth;
  const Eigen::Matrix3f back = relief_.axes().transpose().cast<float>();
  for (std::size_t i = 0; i < places.size(); ++i) {
    const bool here = !std::isnan(lanes.height[i]);
    for (int k = 0; k < kSectors; ++k)
      out[i].from[static_cast<std::size_t>(k)] =
          here ? Eigen::Vector3f(back * Eigen::Vector3f(sums[k][0][i], sums[k][1][i], sums[k][2][i]) * scale)
               : Eigen::Vector3f::Zero();
  }
}

}  // namespace selenograph::engine
