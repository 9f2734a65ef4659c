#include "engine/indirect/slope_light.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numbers>
#include <utility>

#include "engine/support/stopwatch.h"

namespace selenograph::engine {
namespace {

constexpr double kPi = std::numbers::pi;

// Returns the map's albedo on a cell; 1 without a map.
double albedo_at(const GroundLight& light, std::size_t cell) {
  return light.albedo.empty() ? 1 : static_cast<double>(light.albedo[cell]);
}

// Turns the lanes to an azimuth of the grids: the unit vector (ux, uy). Sets `along` of the directions to its part
// perpendicular to their `up`, which differs from lane to lane.
void aim(float ux, float uy, MarchLanes& lanes, AzimuthLanes& directions) {
  lanes.ux = ux;
  lanes.uy = uy;
  for (int i = 0; i < kPacket; ++i) {
    const float vertical = ux * directions.up[0][i] + uy * directions.up[1][i];
    const float x = ux - vertical * directions.up[0][i], y = uy - vertical * directions.up[1][i],
                z = -vertical * directions.up[2][i];
    const float inverse_length = 1 / std::sqrt(x * x + y * y + z * z);
    directions.along[0][i] = x * inverse_length;
    directions.along[1][i] = y * inverse_length;
    directions.along[2][i] = z * inverse_length;
  }
}

}  // namespace

double share_of_disc_above(double x) {
  if (x >= 1) return 0;
  if (x <= -1) return 1;
  return 0.5 - (std::asin(x) + x * std::sqrt(1 - x * x)) / kPi;
}

SkyDisc::SkyDisc(const Relief& relief, const Vec3& direction, double angular_radius_deg)
    : relief_(relief), direction_(relief.axes() * direction), radius_(angular_radius_deg * kRadiansPerDegree) {}

void SkyDisc::shares(std::size_t first_grid, int stride, MarchLanes& lanes, float* share) const {
  alignas(64) float sufficient_tangent[kPacket];
  alignas(64) float horizon[kPacket];  // tangents
  double elevation[kPacket];           // of the disc's middle, rad
  for (int i = 0; i < kPacket; ++i) {
    const Vec3 plane(static_cast<double>(lanes.x[i]), static_cast<double>(lanes.y), kMoonRadius_m);
    elevation[i] = std::asin(std::clamp(plane.normalized().dot(direction_), -1.0, 1.0));
    // A horizon above the disc's upper rim hides all of it. A lane without a height needs no horizon.
    sufficient_tangent[i] = static_cast<float>(std::tan(std::min(elevation[i] + radius_, 1.57)));
    if (std::isnan(lanes.height[i])) sufficient_tangent[i] = -std::numeric_limits<float>::infinity();
  }
  // Direction of the great circle to the source, from the middle lane for all lanes. In the plane it leads to the
  // source's gnomonic position, direction.xy * R / direction.z; here multiplied by direction.z / R, which may be 0.
  const double ux = direction_.x() - static_cast<double>(lanes.x[kPacket / 2]) * direction_.z() / kMoonRadius_m,
               uy = direction_.y() - static_cast<double>(lanes.y) * direction_.z() / kMoonRadius_m;
  const double length = std::hypot(ux, uy);
  // With the source in the zenith any direction does.
  lanes.ux = length > 1e-12 ? static_cast<float>(ux / length) : 1;
  lanes.uy = length > 1e-12 ? static_cast<float>(uy / length) : 0;
  find_horizon_ahead(relief_, first_grid, lanes, stride, sufficient_tangent, horizon);
  for (int i = 0; i < kPacket; ++i) {
    const double horizon_above_middle = std::atan(static_cast<double>(horizon[i])) - elevation[i];
    share[i] = std::isnan(lanes.height[i]) ? 0
               : radius_ > 0               ? static_cast<float>(share_of_disc_above(horizon_above_middle / radius_))
                                           : (horizon_above_middle > 0 ? 0.F : 1.F);
  }
}

// A square of cells that is lit at once; smaller at a grid's end.
class SlopeLight::Square {
 public:
  // `row`, `column`: those of its south-western cell in the grid with the index `grid_index`.
  Square(const Relief& relief, std::size_t grid_index, int row, int column)
      : grid(grid_index),
        rows(std::min(kSquare, relief.grids()[grid].side - row)),
        columns(std::min(kSquare, relief.grids()[grid].side - column)),
        relief_(relief),
        posts_(relief.grids()[grid]),
        row_(row),
        column_(column) {}
  // Returns the number in the grid of the cell in the square's row `r` and column `c`, which is that of its
  // south-western post.
  std::size_t post(int r, int c) const {
    return static_cast<std::size_t>(row_ + r) * static_cast<std::size_t>(posts_.side) +
           static_cast<std::size_t>(column_ + c);
  }
  using Cells = std::array<Relief::Cell, kPacket>;
  // Returns the middles of a row of cells as points of a march, and sets the cells. Lanes beyond the grid's end repeat
  // the last cell at positions of their own.
  MarchLanes march_lanes(int r, Cells& cells) const {
    static_assert(kSquare == kPacket);
    MarchLanes lanes;
    lanes.y = static_cast<float>(posts_.coordinate_m(row_ + r + 0.5));
    for (int i = 0; i < kPacket; ++i) {
      cells[static_cast<std::size_t>(i)] = relief_.cell(grid, post(r, std::min(i, columns - 1)));
      lanes.x[i] = static_cast<float>(posts_.coordinate_m(column_ + i + 0.5));
      lanes.height[i] = cells[static_cast<std::size_t>(i)].height;
    }
    return lanes;
  }

  // Returns the row of cells at whose middles the light of other ground is gathered.
  int middle_row() const { return rows / 2; }
  int row() const { return row_; }
  int column() const { return column_; }

  const std::size_t grid;
  const int rows, columns;

 private:
  const Relief& relief_;
  const ReliefGrid& posts_;
  int row_, column_;
};

SlopeLight::SlopeLight(const Relief& relief, SlopeLightSource source, const GroundViewStore& store)
    : relief_(relief),
      source_(std::move(source)),
      store_(store),
      disc_(relief, source_.sun.direction, source_.sun.angular_radius_deg),
      azimuths_(disc_.direction().z() < std::sin(kLowSun_deg * kRadiansPerDegree) ? kAzimuthsAtLowSun : kAzimuths),
      squares_(relief.grids().size()) {
  constexpr int kGlowSteps = 16;
  if (source_.bounces > 1 && !source_.albedo_is_w) glows_ = {diffuse_albedo(source_.brdf) / kPi};
  if (source_.bounces > 1 && source_.albedo_is_w)
    for (int k = 0; k <= kGlowSteps; ++k)
      glows_.push_back(diffuse_albedo(source_.brdf, 1 - std::pow(k / double(kGlowSteps), 2)) / kPi);
  for (std::size_t g = 0; g < squares_.size(); ++g) {
    const ReliefGrid& grid = relief.grids()[g];
    GroundLight& light = ground_.emplace_back(LitGrid{&grid, {}}).light;
    const std::size_t cells = static_cast<std::size_t>(grid.side) * static_cast<std::size_t>(grid.side) + kPadding;
    const int per_side = squares_[g].per_side = (grid.side + kSquare - 1) / kSquare;
    const std::size_t squares = static_cast<std::size_t>(per_side) * static_cast<std::size_t>(per_side);
    for (GroundLight::Values* values : {&light.nx, &light.ny, &light.lit}) values->resize(cells);
    if (source_.albedo) light.albedo.resize(cells);
    squares_[g].lit = std::make_unique<dem::Once[]>(squares);
    for (std::size_t k = 0; k + 1 < static_cast<std::size_t>(source_.bounces); ++k) {
      light.glow[k].resize(cells);
      squares_[g].glows[k] = std::make_unique<dem::Once[]>(squares);
    }
  }
}

std::size_t SlopeLight::bytes() const {
  const auto glows = static_cast<std::size_t>(source_.bounces - 1);
  std::size_t sum = 0;
  for (const LitGrid& ground : ground_)
    sum += ((3 + glows) * ground.light.lit.capacity() + ground.light.albedo.capacity()) * sizeof(float);
  for (const Squares& squares : squares_)
    sum += static_cast<std::size_t>(squares.per_side) * static_cast<std::size_t>(squares.per_side) * sizeof(dem::Once) *
           (1 + glows);
  return sum;
}

void SlopeLight::light_squares(std::span<const GroundView::Square> squares, int bounces, const StopToken& stop,
                               LightWork* work) const {
  const auto square = [&](const GroundView::Square& id) {
    const auto side = static_cast<std::uint32_t>(squares_[id.grid].per_side);
    return Square(relief_, id.grid, static_cast<int>(id.index / side) * kSquare,
                  static_cast<int>(id.index % side) * kSquare);
  };
  Stopwatch watch;
  for (const GroundView::Square& id : squares)
    squares_[id.grid].lit[id.index].run([&] { light_in_sun(square(id), stop); });
  if (work) work->sunlit_ms += watch.lap_ms();
  if (bounces == 1) return;
  for (const GroundView::Square& id : squares)
    squares_[id.grid].glows[static_cast<std::size_t>(bounces - 2)][id.index].run(
        [&] { light_by_ground(square(id), bounces - 1, stop); });
  if (work) work->bounces_ms += watch.lap_ms();
}

// The square's own grid and the coarser ones cast shadows on it.
void SlopeLight::light_in_sun(const Square& square, const StopToken& stop) const {
  stop.check();
  const ReliefGrid& grid = relief_.grids()[square.grid];
  GroundLight& light = ground_[square.grid].light;
  // A cell that faces less than this cosine toward the Sun's middle has its whole disc behind it.
  const double min_cos_incidence = -std::sin(source_.sun.angular_radius_deg * kRadiansPerDegree);
  std::vector<float> albedo;
  if (source_.albedo) {
    albedo.resize(static_cast<std::size_t>(square.rows * square.columns));
    std::vector<Vec3> directions;
    for (int r = 0; r < square.rows; ++r)
      for (int c = 0; c < square.columns; ++c)
        directions.push_back(relief_.direction(square.grid, square.post(r, c), true));
    source_.albedo(grid.spacing_m, directions, albedo, stop);
  }
  for (int r = 0; r < square.rows; ++r) {
    Square::Cells cells;
    MarchLanes lanes = square.march_lanes(r, cells);
    alignas(64) float share[kPacket];
    // Without a height, a cell that faces away from the Sun needs no march and has share 0.
    for (std::size_t i = 0; i < kPacket; ++i)
      if (!(cells[i].normal.cast<double>().dot(disc_.direction()) > min_cos_incidence)) lanes.height[i] = std::nanf("");
    disc_.shares(square.grid, static_cast<int>(grid.coarser), lanes, share);
    for (int c = 0; c < square.columns; ++c) {
      const std::size_t cell = square.post(r, c);
      const Vec3f& normal = cells[static_cast<std::size_t>(c)].normal;
      light.nx[cell] = normal.x();
      light.ny[cell] = normal.y();
      light.lit[cell] = share[c];
      if (source_.albedo) light.albedo[cell] = albedo[static_cast<std::size_t>(r * square.columns + c)];
    }
  }
}

// The glow counts as diffuse light. The light is gathered at the cells of the middle row only, one for each column: a
// square is at most a third as wide as the distance from which a march reads it.
void SlopeLight::light_by_ground(const Square& square, int bounces, const StopToken& stop) const {
  GroundLight& light = ground_[square.grid].light;
  GroundLight::Values& glow = light.glow[static_cast<std::size_t>(bounces - 1)];
  Square::Cells cells;
  MarchLanes lanes = square.march_lanes(square.middle_row(), cells);
  ArrivingLight arriving;
  gather({square.grid,
          square.row() + square.middle_row(),
          square.column(),
          static_cast<int>(relief_.grids()[square.grid].coarser),
          true,
          {kAzimuthsOfGround, 0.5}},
         lanes, bounces, false, arriving, stop);
  for (int r = 0; r < square.rows; ++r) {
    for (int c = 0; c < square.columns; ++c) {
      const std::size_t cell = square.post(r, c);
      const float nx = light.nx[cell], ny = light.ny[cell], nz = std::sqrt(std::max(1 - nx * nx - ny * ny, 0.F));
      float irradiance = 0;
      for (const auto& sector : arriving.from)
        irradiance += std::max(nx * sector[0][c] + ny * sector[1][c] + nz * sector[2][c], 0.F);
      glow[cell] = irradiance * static_cast<float>(glow_of(albedo_at(light, cell)));
    }
  }
}

double SlopeLight::glow_of(double albedo) const {
  if (!source_.albedo_is_w) return glows_.front() * albedo;
  const auto last = static_cast<double>(glows_.size() - 1);
  const double position = last * std::sqrt(std::clamp(1 - albedo, 0.0, 1.0));
  const auto step = static_cast<std::size_t>(std::min(position, last - 1));
  return std::lerp(glows_[step], glows_[step + 1], position - static_cast<double>(step));
}

double SlopeLight::reflected(double mu0, double mu, double cos_phase, double albedo) const {
  if (!source_.albedo_is_w) return albedo * source_.brdf.times_mu0(mu0, mu, cos_phase);
  // Only the Brdf's function for packets takes a w: fill all sixteen lanes with the same values.
  struct alignas(64) Lanes {
    double values[kPacket];
    explicit Lanes(double value) { std::fill_n(values, kPacket, value); }
  };
  const Lanes mu0_lanes(mu0), mu_lanes(mu), cos_phase_lanes(cos_phase), w_lanes(albedo);
  Lanes reflected_lanes(0);
  source_.brdf.times_mu0(mu0_lanes.values, mu_lanes.values, cos_phase_lanes.values, w_lanes.values,
                         reflected_lanes.values);
  return reflected_lanes.values[0];
}

float SlopeLight::radiosity(int row, int column, const StopToken& stop) const {
  const GroundView::Square square{
      0, static_cast<std::uint32_t>(row / kSquare * squares_.front().per_side + column / kSquare)};
  light_squares({&square, 1}, source_.bounces, stop);
  const GroundLight& light = ground_.front().light;
  const auto post = static_cast<std::size_t>(relief_.grids().front().index(column, row));
  const Vec3 normal = relief_.cell(0, post).normal.cast<double>();
  const double mu0 = normal.dot(disc_.direction());
  // The relief's z axis stands for the zenith: it is that of the relief's centre.
  const double albedo = albedo_at(light, post), lit = static_cast<double>(light.lit[post]);
  const double direct = mu0 > 0 && lit > 0 ? lit * reflected(mu0, normal.z(), disc_.direction().z(), albedo) : 0,
               glow = source_.bounces == 1
                          ? 0
                          : static_cast<double>(light.glow[static_cast<std::size_t>(source_.bounces - 2)][post]);
  return static_cast<float>(kPi * source_.irradiance_w_m2 * (direct + glow));
}

void SlopeLight::set_squares(std::size_t first_grid, GroundView& view) const {
  std::vector<std::vector<bool>> has(squares_.size() - first_grid);
  for (std::size_t g = 0; g < has.size(); ++g) {
    const auto squares = static_cast<std::size_t>(squares_[first_grid + g].per_side);
    has[g].resize(squares * squares);
  }
  for (const GroundSegment& segment : view.segments) {
    const ReliefGrid& grid = relief_.grids()[first_grid + segment.grid];
    const float pitch = static_cast<float>(view.stride) / grid.coarser;
    // All cells that the vector loads read; for a pitch above 1 also those between the lanes.
    const float columns_read =
        pitch > 1 ? static_cast<float>(kPacket) * pitch - 1 : static_cast<float>(kPacket - 1) * pitch;
    const auto square_of = [&](float column) {
      return std::clamp(static_cast<int>(column), 0, grid.side - 1) / kSquare;
    };
    const int first = segment.row / kSquare * squares_[first_grid + segment.grid].per_side;
    for (int c = square_of(segment.column); c <= square_of(segment.column + columns_read); ++c)
      has[segment.grid][static_cast<std::size_t>(first + c)] = true;
  }
  for (std::size_t g = 0; g < has.size(); ++g)
    for (std::size_t index = 0; index < has[g].size(); ++index)
      if (has[g][index])
        view.squares.push_back({static_cast<std::uint32_t>(first_grid + g), static_cast<std::uint32_t>(index)});
}

GroundView SlopeLight::march_view(const Gatherers& gatherers, MarchLanes& lanes, AzimuthLanes& directions) const {
  const Azimuths& azimuths = gatherers.azimuths;
  GroundView view;
  view.stride = gatherers.stride;
  view.azimuths.reserve(static_cast<std::size_t>(azimuths.count));
  constexpr std::size_t kSegmentsPerAzimuth = 96;  // more than most have
  view.segments.reserve(kSegmentsPerAzimuth * static_cast<std::size_t>(azimuths.count));
  alignas(64) float horizon[kPacket];
  for (int azimuth = 0; azimuth < azimuths.count; ++azimuth) {
    const double phi = (azimuth + azimuths.first) * 2 * kPi / azimuths.count;
    aim(static_cast<float>(std::cos(phi)), static_cast<float>(std::sin(phi)), lanes, directions);
    find_visible_ground(relief_, gatherers.grid, lanes, view, horizon);
    add_sky(directions, horizon, view.sky);
  }
  set_squares(gatherers.grid, view);
  return view;
}

std::shared_ptr<const GroundView> SlopeLight::view_of(const Gatherers& gatherers, MarchLanes& lanes,
                                                      AzimuthLanes& directions, bool keep_view,
                                                      const StopToken& stop) const {
  if (!keep_view || !store_.views) return std::make_shared<const GroundView>(march_view(gatherers, lanes, directions));
  ContentHash key;
  key.add(store_.relief.low);
  key.add(store_.relief.high);
  key.add(gatherers.grid);
  key.add(gatherers.of_cells);
  for (const int value : {gatherers.row, gatherers.column, gatherers.stride, gatherers.azimuths.count}) key.add(value);
  key.add(gatherers.azimuths.first);
  return store_.views->get(
      key.key(),
      [&]() -> GroundViewStore::Views::Loaded {
        GroundView view = march_view(gatherers, lanes, directions);
        view.segments.shrink_to_fit();
        const std::size_t bytes = view.bytes();
        return {std::make_shared<const GroundView>(std::move(view)), bytes};
      },
      stop);
}

void SlopeLight::gather(const Gatherers& gatherers, MarchLanes& lanes, int bounces, bool keep_view, ArrivingLight& out,
                        const StopToken& stop, LightWork* work) const {
  const std::span<const LitGrid> ground = std::span(ground_).subspan(gatherers.grid);
  AzimuthLanes directions;
  for (int k = 0; k < 3; ++k) directions.sun[k] = static_cast<float>(disc_.direction()[k]);
  for (int i = 0; i < kPacket; ++i) {
    const Vec3 up = Vec3(static_cast<double>(lanes.x[i]), static_cast<double>(lanes.y), kMoonRadius_m).normalized();
    for (int k = 0; k < 3; ++k) directions.up[k][i] = static_cast<float>(up[k]);
  }
  Stopwatch watch;
  const std::shared_ptr<const GroundView> view = view_of(gatherers, lanes, directions, keep_view, stop);
  if (work) work->views_ms += watch.lap_ms();
  light_squares(view->squares, bounces, stop, work);
  std::copy_n(&view->sky[0][0], 3 * kPacket, &out.sky[0][0]);
  VisibleSegment segment;
  SegmentLight light;
  alignas(64) double reflected[kPacket];
  const std::size_t azimuths_per_sector = view->azimuths.size() / kSectors;
  for (std::size_t azimuth = 0; azimuth < view->azimuths.size(); ++azimuth) {
    aim(view->azimuths[azimuth].ux, view->azimuths[azimuth].uy, lanes, directions);
    auto& sector_sum = out.from[azimuth / azimuths_per_sector];
    SegmentCursor cursor(*view, azimuth);
    while (next_lit_segment(*view, ground, directions, bounces - 2, cursor, segment, light)) {
      source_.brdf.times_mu0(light.mu0, light.mu, light.cos_phase, source_.albedo_is_w ? light.albedo : nullptr,
                             reflected);
      add_segment(segment, directions, light, reflected, !source_.albedo_is_w, sector_sum);
    }
  }
  // Turn the sums over azimuths into integrals: each azimuth stands for an angle of 2 pi / count.
  const auto azimuth_step = static_cast<float>(2 * kPi / gatherers.azimuths.count);
  const auto scale = [&](float(&sum)[3][kPacket]) {
    for (auto& component : sum)
      for (int i = 0; i < kPacket; ++i) component[i] = std::isnan(lanes.height[i]) ? 0 : azimuth_step * component[i];
  };
  for (auto& sum : out.from) scale(sum);
  scale(out.sky);
}

void SlopeLight::gather(int row, int column, int stride, std::span<SectorLight, kPacket> out, const StopToken& stop,
                        bool keep_view, LightWork* work) const {
  MarchLanes lanes = posts_in_row(relief_, row, column, stride);
  ArrivingLight arriving;
  // Rows of posts alternate between azimuths at 1/4 and at 3/4 of the step, halfway between each other.
  gather({0, row, column, stride, false, {azimuths_, row / stride % 2 ? 0.75 : 0.25}}, lanes, source_.bounces,
         keep_view, arriving, stop, work);
  const Mat3f moon_from_grids = relief_.axes().transpose().cast<float>();
  for (int i = 0; i < kPacket; ++i) {
    const auto in_moon_axes = [&](const float(&sum)[3][kPacket]) -> Vec3f {
      return moon_from_grids * Vec3f(sum[0][i], sum[1][i], sum[2][i]);
    };
    SectorLight& light = out[static_cast<std::size_t>(i)];
    for (std::size_t k = 0; k < kSectors; ++k)
      light.from[k] = in_moon_axes(arriving.from[k]) * static_cast<float>(source_.irradiance_w_m2);
    light.sky = in_moon_axes(arriving.sky);
  }
}

}  // namespace selenograph::engine
