#include "dem/detail/mean_correction.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

#include "dem/base/parallel.h"
#include "dem/detail/direction_grid.h"
#include "dem/grid/lattice.h"
#include "dem/posts/post_patch.h"
#include "dem/terrain/surface_place.h"

namespace selenograph::dem {
namespace {

using std::numbers::pi;

// A crater on the lattice of posts, the cells around it, and their correction. Coordinates x and y are metres east and
// north of the crater's centre:
//
//        +-----+-----+-----+
//        |  x  |  x  |  x  |    x  posts, centres of cells; cell size east_m_ by north_m_
//        +-----+-----+-----+    o  the crater's centre: east_, north_ cells from the post south-west of it
//        |  x  | xo  |  x  |    (side_ x side_ cells in all, half_ to every side of that post)
//        +-----+-----+-----+
class CraterAmongPosts {
 public:
  CraterAmongPosts(const Crater& crater, int posts_level) : crater_(crater) {
    const Geographic g = to_geographic(crater.centre * kMoonRadius_m);
    const BlockExtent e = extent_of(block_at_place(posts_level, g.lat_deg, g.lon_deg));
    const double tick_m = pi / 180 / kTicksPerDegree * kMoonRadius_m;
    north_m_ = e.lat_step * tick_m;
    // Limit how narrow a cell gets: near a pole, where cells are slivers, the correction is small (correction_weight).
    east_m_ = std::max(e.lon_step * tick_m * std::cos(g.lat_deg * pi / 180), north_m_ / 4);
    const double row = (g.lat_deg + 90) * kTicksPerDegree / e.lat_step,
                 column = (g.lon_deg + 180) * kTicksPerDegree / e.lon_step;
    north_ = row - std::floor(row);
    east_ = column - std::floor(column);
    weight_ = correction_weight(static_cast<Tick>(row * e.lat_step), e.lat_step);
    samples_ = Detail::samples_per_cell(octave_of(crater.diameter_m), posts_level);
  }

  double post_spacing_m() const { return north_m_; }

  // Returns the share of the crater's depth that is left (mean_correction.h): rim minus centre, with and without the
  // correction.
  double depth_left() {
    compute_correction();
    constexpr int kRimSamples = 16;
    double full_depth_m = -height_m(0, 0), left_depth_m = correction_m(0, 0) + full_depth_m;
    for (int i = 0; i < kRimSamples; ++i) {
      const double angle = 2 * pi * i / kRimSamples;
      const double x = std::cos(angle) * crater_.diameter_m / 2, y = std::sin(angle) * crater_.diameter_m / 2;
      const double rim_m = height_m(x, y);
      full_depth_m += rim_m / kRimSamples;
      left_depth_m += (rim_m - correction_m(x, y)) / kRimSamples;
    }
    return std::clamp(left_depth_m / full_depth_m, 0.0, 1.0);
  }

 private:
  // Returns the crater's own height.
  double height_m(double x, double y) const {
    return crater_.scale * CraterShape::of_all().height(std::hypot(x, y) / (crater_.diameter_m / 2), crater_.age);
  }
  // Returns the correction, interpolated between posts as PostReader does.
  double correction_m(double x, double y) const {
    const double column = half_ + east_ + x / east_m_, row = half_ + north_ + y / north_m_;
    const int c = static_cast<int>(column), r = static_cast<int>(row);
    const std::array<double, 4> along = cubic_weights(column - c), across = cubic_weights(row - r);
    double sum = 0;
    for (int j = 0; j < 4; ++j)
      for (int i = 0; i < 4; ++i)
        sum += across[static_cast<std::size_t>(j)] * along[static_cast<std::size_t>(i)] *
               corrections_m_[static_cast<std::size_t>((r + j - 1) * side_ + c + i - 1)];
    return weight_ * sum;
  }
  void compute_correction() {
    half_ = static_cast<int>(std::ceil(crater_.diameter_m / 2 / std::min(east_m_, north_m_))) + 3 + kCellsAround;
    side_ = 2 * half_ + 1;
    std::vector<double> means(static_cast<std::size_t>(side_ * side_));
    for (int r = 0; r < side_; ++r)
      for (int c = 0; c < side_; ++c) means[static_cast<std::size_t>(r * side_ + c)] = mean_m(r - half_, c - half_);
    corrections_m_ = sharpened(means, static_cast<std::size_t>(side_));
  }
  // Returns the crater's mean height over a cell, by row and column from the post south-west of its centre.
  double mean_m(int row, int column) const {
    const double x = (column - east_) * east_m_, y = (row - north_) * north_m_;
    if (std::hypot(std::max(std::abs(x) - east_m_ / 2, 0.0), std::max(std::abs(y) - north_m_ / 2, 0.0)) >
        crater_.reach_m())
      return 0;
    double sum = 0;
    for (int j = 0; j < samples_; ++j)
      for (int i = 0; i < samples_; ++i)
        sum += height_m(x + ((i + 0.5) / samples_ - 0.5) * east_m_, y + ((j + 0.5) / samples_ - 0.5) * north_m_);
    return sum / (samples_ * samples_);
  }

  const Crater& crater_;
  double north_m_, east_m_;  // size of a cell
  double north_, east_;      // the crater's centre, from the post south-west of it, in cells
  double weight_;            // correction_weight at the crater
  int samples_;              // per side of a cell
  int half_ = 0, side_ = 0;  // cells to either side of the middle, and in all
  std::vector<double> corrections_m_;
};

// Returns the factors of an octave's relief at n x n samples of the cells of a sub-block and around it; empty: 1.
std::vector<double> factors_of_samples(const Detail& detail, const SubBlock& sub_block, int margin, int octave, int n,
                                       const ReliefFactors& relief_factors) {
  if (!detail.relief().follows_posts(octave)) return {};
  const BlockExtent e = sub_block.extent();
  std::vector<std::int64_t> lats, lons;
  for (int i = 0; i < (e.quads + 1 + 2 * margin) * n; ++i) {
    const double post = (i + 0.5) / n - 0.5 - margin;
    lats.push_back(e.lat0 + std::llround(post * static_cast<double>(e.lat_step)));
    lons.push_back(e.lon0 + std::llround(post * static_cast<double>(e.lon_step)));
  }
  return relief_factors(lats, lons);
}

// Returns a rectangle of a square table, row by row; empty if the table is.
std::vector<double> sub_table(const std::vector<double>& table, std::size_t first_row, std::size_t rows,
                              std::size_t first_column, std::size_t columns) {
  std::vector<double> out;
  if (table.empty()) return out;
  const auto side = static_cast<std::size_t>(std::lround(std::sqrt(static_cast<double>(table.size()))));
  for (std::size_t r = first_row; r < first_row + rows; ++r) {
    const auto row = table.begin() + static_cast<std::ptrdiff_t>(r * side + first_column);
    out.insert(out.end(), row, row + static_cast<std::ptrdiff_t>(columns));
  }
  return out;
}

// Returns the means of the detail over the cells of a sub-block and of `margin` cells around it, row by row.
// A cell is centred at its post and as wide as the posts' spacing. Each octave is sampled at n x n positions per cell:
//
//   +-------+-------+
//   | . . . | . . . |     x  post, centre of its cell
//   | . x . | . x . |     .  samples (n = 3 here; 8 or more, by the octave)
//   | . . . | . . . |     means of octaves add up to the cell's mean
//   +-------+-------+
//
// The sampling grid is laid out for the whole block, so that a cell's mean is the same to the bit in every sub-block
// that includes the cell.
std::vector<double> cell_means(const Detail& detail, const SubBlock& sub_block, int margin,
                               const ReliefFactors& relief_factors, const StopToken& stop) {
  const BlockExtent e = extent_of(sub_block.block);
  const auto cells = static_cast<std::size_t>(sub_block.quads() + 1 + 2 * margin);
  std::vector<double> means(cells * cells);
  for (int octave = Detail::smallest_octave(sub_block.block.level + Detail::kCellLevels);
       octave < Detail::past_largest_octave(sub_block.block.level); ++octave) {
    const int samples = Detail::samples_per_cell(octave, sub_block.block.level);
    const auto n = static_cast<std::size_t>(samples);
    const BlockDirections directions(e, 0.5 / samples - 0.5 - margin, 1.0 / samples,
                                     (e.quads + 1 + 2 * margin) * samples);
    const std::vector<double> factors = factors_of_samples(detail, sub_block, margin, octave, samples, relief_factors);
    const auto first = [&](int index) { return static_cast<std::size_t>(index * sub_block.quads()) * n; };
    // Work in squares of cells, whose samples fit in the processor's caches.
    constexpr std::size_t kSquare = 9;
    const std::size_t squares = (cells + kSquare - 1) / kSquare;
    in_parallel(squares * squares, [&](std::size_t i) {
      const std::size_t r0 = i / squares * kSquare, c0 = i % squares * kSquare;
      const std::size_t rows = std::min(kSquare, cells - r0), columns = std::min(kSquare, cells - c0);
      std::vector<double> heights(rows * n * columns * n);
      detail.add_octave(sub_grid(directions.grid(), first(sub_block.north) + r0 * n, rows * n,
                                 first(sub_block.east) + c0 * n, columns * n),
                        octave, heights, stop, sub_table(factors, r0 * n, rows * n, c0 * n, columns * n));
      const double* height_m = heights.data();
      for (std::size_t r = r0 * n; r < (r0 + rows) * n; ++r)
        for (std::size_t c = c0; c < c0 + columns; ++c)
          for (std::size_t k = 0; k < n; ++k) means[r / n * cells + c] += *height_m++ / (samples * samples);
    });
  }
  return means;
}

}  // namespace

std::vector<double> sharpened(const std::vector<double>& means, std::size_t side) {
  // A surface interpolated by Catmull-Rom between the cells' means has other means over the cells: along each axis, the
  // given ones filtered by (-2.5, 18, 161, 18, -2.5) / 192, the integral of its weights over a cell. kSharpened is the
  // inverse of that symmetric filter, to 1e-3: its middle weight, then those of cells 1 to 4 away.
  constexpr std::array kSharpened{1.225297469, -0.143363406, 0.035794135, -0.006376901, 0.001297438};
  static_assert(kSharpened.size() == kCellsAround + 1);
  std::vector<double> sharp(means), out(means);  // after the pass along rows, and after that along columns
  const auto sharpen = [&](const std::vector<double>& from, std::vector<double>& to, std::size_t step) {
    for (std::size_t cell = kCellsAround * step; cell + kCellsAround * step < from.size(); ++cell) {
      to[cell] = kSharpened[0] * from[cell];
      for (std::size_t k = 1; k < kSharpened.size(); ++k)
        to[cell] += kSharpened[k] * (from[cell - k * step] + from[cell + k * step]);
    }
  };
  sharpen(means, sharp, 1);
  sharpen(sharp, out, side);
  return out;
}

double correction_weight(Tick lat, Tick lat_step) {
  const double posts_from_pole = static_cast<double>(std::min(lat, kLatTicks - lat)) / lat_step;
  return std::clamp((posts_from_pole - 2) / 6, 0.0, 1.0);
}

// Averages the detail over the cells, and sharpens the means. The block's heights are the corrections, m.
std::shared_ptr<const Block> make_mean_correction(const Detail& detail, const SubBlock& sub_block,
                                                  const ReliefFactors& relief_factors, const StopToken& stop) {
  const BlockExtent e = sub_block.extent();
  const auto side = static_cast<std::size_t>(e.quads + 1 + 2 * kCellsAround);
  const std::vector<double> corrections_m =
      sharpened(cell_means(detail, sub_block, kCellsAround, relief_factors, stop), side);
  auto block = empty_block(sub_block.block, e);
  block->vertices.reserve(block->index(e.quads, e.quads) + 1);
  for (int r = 0; r <= e.quads; ++r) {
    const double weight = correction_weight(e.lat0 + r * e.lat_step, e.lat_step);
    for (int c = 0; c <= e.quads; ++c) {
      const std::size_t cell =
          static_cast<std::size_t>(r + kCellsAround) * side + static_cast<std::size_t>(c + kCellsAround);
      block->vertices.push_back({static_cast<float>(weight * corrections_m[cell]), Vec3f::zero()});
    }
  }
  return block;
}

double depth_left(const Crater& crater, int posts_level) {
  CraterAmongPosts crater_among_posts(crater, posts_level);
  // Skip craters narrower than this share of a post spacing: they would lose a hundredth of their depth.
  constexpr double kNegligible = 0.25;
  return crater.diameter_m < kNegligible * crater_among_posts.post_spacing_m() ? 1 : crater_among_posts.depth_left();
}

}  // namespace selenograph::dem
