#include "engine/indirect/slope_light.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <utility>

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
  lanes.ux = ux, lanes.uy = uy;
  for (int i = 0; i < kPacket; ++i) {
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

void SkyDisc::shares(std::span<const GridView> grids, int stride, MarchLanes& lanes, float* share) const {
  alignas(64) float enough[kPacket], horizon[kPacket];
  double tangent[kPacket], cosine[kPacket];
  for (int i = 0; i < kPacket; ++i) {
    const Vec3 plane(static_cast<double>(lanes.x[i]), static_cast<double>(lanes.y), kMoonRadius_m);
    const double sine = plane.normalized().dot(direction_);
    cosine[i] = std::sqrt(std::max(1 - sine * sine, 1e-12)), tangent[i] = sine / cosine[i];
    // What hides all of it. Of a lane without a height, nothing need be known.
    enough[i] = static_cast<float>(std::tan(std::min(std::asin(std::clamp(sine, -1.0, 1.0)) + radius_, 1.57)));
    if (std::isnan(lanes.height[i])) enough[i] = -std::numeric_limits<float>::infinity();
  }
  // Where the great circle to the source goes; for all places, from the middle one.
  const double ux = direction_.x() - static_cast<double>(lanes.x[kPacket / 2]) * direction_.z() / kMoonRadius_m,
               uy = direction_.y() - static_cast<double>(lanes.y) * direction_.z() / kMoonRadius_m;
  const double length = std::hypot(ux, uy);
  lanes.ux = length > 1e-12 ? static_cast<float>(ux / length) : 1;
  lanes.uy = length > 1e-12 ? static_cast<float>(uy / length) : 0;
  find_horizons(grids, sphere_, lanes, stride, enough, horizon);
  for (int i = 0; i < kPacket; ++i) {
    const double above = static_cast<double>(horizon[i]) - tangent[i];
    share[i] = std::isnan(lanes.height[i]) ? 0
               : radius_ > 0               ? static_cast<float>(share_above(above * cosine[i] * cosine[i] / radius_))
                                           : (above > 0 ? 0.F : 1.F);
  }
}

SlopeLight::SlopeLight(const Relief& relief, SlopeLightSource source)
    : relief_(relief),
      source_(std::move(source)),
      disc_(relief, source_.sun.direction, source_.sun.angular_radius_deg),
      azimuths_(disc_.direction().z() < std::sin(kLowSun_deg * kRadiansPerDegree) ? kAzimuthsAtLowSun : kAzimuths),
      ground_(relief.grids()),
      grids_(relief.views()) {
  for (std::size_t g = 0; g < relief.grids(); ++g) {
    Ground& ground = ground_[g];
    const auto side = static_cast<std::size_t>(relief.side(g));
    for (GroundLight::Values* values : {&ground.light.nx, &ground.light.ny, &ground.light.lit, &ground.light.albedo})
      values->resize(side * side + kPadding);
    ground.squares = (relief.side(g) + kSquare - 1) / kSquare;
    ground.lit = std::make_unique<dem::Once[]>(static_cast<std::size_t>(ground.squares) *
                                               static_cast<std::size_t>(ground.squares));
    grids_[g].light = &ground.light;
  }
}

std::size_t SlopeLight::bytes() const {
  std::size_t sum = 0;
  for (const Ground& ground : ground_)
    sum += 4 * ground.light.lit.capacity() * sizeof(float) +
           static_cast<std::size_t>(ground.squares) * static_cast<std::size_t>(ground.squares) * sizeof(dem::Once);
  return sum;
}

void SlopeLight::light_cells(std::size_t grid, int row, int first_column, int last_column,
                             const StopToken& stop) const {
  const Ground& ground = ground_[grid];
  const int side = grids_[grid].side;
  const auto square = [&](int at) { return std::clamp(at, 0, side - 1) / kSquare; };
  for (int c = square(first_column); c <= square(last_column); ++c) {
    const int r = square(row);
    ground.lit[static_cast<std::size_t>(r) * static_cast<std::size_t>(ground.squares) + static_cast<std::size_t>(c)]
        .run([&] { light_square(grid, r * kSquare, c * kSquare, stop); });
  }
}

// The grid's own heights and those of the coarser ones shade it.
void SlopeLight::light_square(std::size_t grid, int row, int column, const StopToken& stop) const {
  stop.check();
  const GridView& view = grids_[grid];
  GroundLight& light = ground_[grid].light;
  const std::span<const GridView> around = std::span(grids_).subspan(grid);
  const double lowest = -std::sin(source_.sun.angular_radius_deg * kRadiansPerDegree);
  const int rows = std::min(kSquare, view.side - row), columns = std::min(kSquare, view.side - column);
  const auto post = [&](int r, int c) {
    return static_cast<std::size_t>(row + r) * static_cast<std::size_t>(view.side) +
           static_cast<std::size_t>(column + c);
  };
  std::vector<float> albedo(static_cast<std::size_t>(rows * columns), 1.F);
  if (source_.albedo) {
    std::vector<Vec3> directions;
    for (int r = 0; r < rows; ++r)
      for (int c = 0; c < columns; ++c) directions.push_back(relief_.direction(grid, post(r, c), true));
    source_.albedo(static_cast<double>(view.spacing_m), directions, albedo, stop);
  }
  static_assert(kSquare == kPacket);
  for (int r = 0; r < rows; ++r) {
    MarchLanes lanes;
    lanes.y = view.first_m + (static_cast<float>(row + r) + 0.5F) * view.spacing_m;
    Relief::Cell cells[kPacket];
    alignas(64) float share[kPacket];
    for (int i = 0; i < kPacket; ++i) {
      const int c = std::min(i, columns - 1);
      cells[i] = relief_.cell(grid, post(r, c));
      lanes.x[i] = view.first_m + (static_cast<float>(column + c) + 0.5F) * view.spacing_m;
      // What is turned away needs no march.
      const bool faces = cells[i].normal.cast<double>().dot(disc_.direction()) > lowest;
      lanes.height[i] = faces ? cells[i].height : std::nanf("");
    }
    disc_.shares(around, static_cast<int>(view.coarser), lanes, share);
    for (int c = 0; c < columns; ++c) {
      const std::size_t at = post(r, c);
      light.nx[at] = cells[c].normal.x(), light.ny[at] = cells[c].normal.y(), light.lit[at] = share[c];
      light.albedo[at] = albedo[static_cast<std::size_t>(r * columns + c)];
    }
  }
}

float SlopeLight::radiosity(int row, int column, const StopToken& stop) const {
  light_cells(0, row, column, column, stop);
  const GroundLight& light = ground_.front().light;
  const std::size_t post =
      static_cast<std::size_t>(row) * static_cast<std::size_t>(grids_.front().side) + static_cast<std::size_t>(column);
  const Eigen::Vector3d normal = relief_.cell(0, post).normal.cast<double>();
  const double mu0 = normal.dot(disc_.direction());
  const auto factor = static_cast<double>(light.lit[post] * (source_.albedo_is_w ? 1 : light.albedo[post]));
  return mu0 > 0 && factor > 0 ? static_cast<float>(kPi * factor * source_.irradiance_w_m2 *
                                                    source_.brdf.times_mu0(mu0, normal.z(), disc_.direction().z()))
                               : 0;
}

void SlopeLight::gather(int row, int column, int stride, std::span<SectorLight, kPacket> out,
                        const StopToken& stop) const {
  MarchLanes lanes = relief_.places(row, column, stride);
  alignas(64) float sums[kSectors][3][kPacket] = {}, sky[3][kPacket] = {}, horizon[kPacket];
  AzimuthLanes azimuths;
  for (int k = 0; k < 3; ++k) azimuths.sun[k] = static_cast<float>(disc_.direction()[k]);
  for (int i = 0; i < kPacket; ++i) {
    const Vec3 d = Vec3(static_cast<double>(lanes.x[i]), static_cast<double>(lanes.y), kMoonRadius_m).normalized();
    for (int k = 0; k < 3; ++k) azimuths.up[k][i] = static_cast<float>(d[k]);
  }
  std::vector<SeenPiece> pieces;
  PieceLight light;
  alignas(64) double reflected[kPacket];
  for (int azimuth = 0; azimuth < azimuths_; ++azimuth) {
    const double phi = (azimuth + 0.5) * 2 * kPi / azimuths_;
    aim(static_cast<float>(std::cos(phi)), static_cast<float>(std::sin(phi)), lanes, azimuths);
    pieces.clear();
    find_pieces(grids_, relief_.sphere(), lanes, stride, pieces, horizon);
    add_sky(azimuths, horizon, sky);
    auto& sum = sums[azimuth / (azimuths_ / kSectors)];
    for (const SeenPiece& piece : pieces) {
      const RowOfCells& cells = piece.cells;
      light_cells(piece.grid, cells.row, static_cast<int>(cells.column),
                  static_cast<int>(cells.column + static_cast<float>(kPacket - 1) * cells.pitch), stop);
      if (!light_piece(piece, grids_[piece.grid], azimuths, light)) continue;
      source_.brdf.times_mu0(light.mu0, light.mu, light.cos_phase, source_.albedo_is_w ? light.albedo : nullptr,
                             reflected);
      add_piece(piece, azimuths, light, reflected, !source_.albedo_is_w, sum);
    }
  }
  const auto turn = static_cast<float>(2 * kPi / azimuths_);
  const Eigen::Matrix3f back = relief_.axes().transpose().cast<float>();
  for (int i = 0; i < kPacket; ++i) {
    const float scale = std::isnan(lanes.height[i]) ? 0 : turn;
    const auto vector = [&](const float(&sum)[3][kPacket], double times) -> Eigen::Vector3f {
      if (scale == 0) return Eigen::Vector3f::Zero();
      return back * Eigen::Vector3f(sum[0][i], sum[1][i], sum[2][i]) * (scale * static_cast<float>(times));
    };
    SectorLight& of = out[static_cast<std::size_t>(i)];
    for (std::size_t k = 0; k < kSectors; ++k) of.from[k] = vector(sums[k], source_.irradiance_w_m2);
    of.sky = vector(sky, 1);
  }
}

}  // namespace selenograph::engine
