#include "dem/gdal/raster.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdint>
#include <limits>
#include <optional>
#include <string>
#include <thread>
#include <vector>

#include "dem/base/error.h"
#include "dem/gdal/raster_file.h"

namespace selenograph::dem {

namespace {

// Waits until the next change of the file will show in its times. Clocks of file systems step: by at most 10 ms if they
// tell nanoseconds, by 2 s if they tell whole seconds. A file that changes twice within a step has the same times after
// both.
void wait_for_next_step(const RasterFile& file) {
  using namespace std::chrono;
  std::int64_t changed_ns = 0;
  for (const FileSeen& seen : file.files) changed_ns = std::max(changed_ns, seen.state.changed_ns);
  constexpr nanoseconds kFineStep = milliseconds(20), kCoarseStep = seconds(2);
  const nanoseconds step = changed_ns % nanoseconds(seconds(1)).count() == 0 ? kCoarseStep : kFineStep;
  const nanoseconds age = system_clock::now().time_since_epoch() - nanoseconds(changed_ns);
  if (age > -step && age < step) std::this_thread::sleep_for(step - age);
}

// Describes a file, again if it changed meanwhile.
RasterFile inspect(const std::string& path) {
  constexpr int kAttempts = 5;
  for (int attempt = 0; attempt < kAttempts; ++attempt) {
    RasterFile file = describe_raster_file(path, {nullptr, Damage::refuse});
    wait_for_next_step(file);
    if (is_current(file)) return file;
  }
  throw DataError(path, "is being written: start again when it is complete");
}

// Returns the error for a file that has changed.
DataError changed(const std::string& path, const char* when) {
  return DataError(path, std::string("has changed ") + when + ": start again to use what is there now");
}

}  // namespace

RasterInfo inspect_raster(const std::string& path, std::vector<std::string>* files) {
  RasterFile file = inspect(path);
  if (files) {
    files->push_back(file.info.path);
    if (file.pds && file.pds->data_path != file.info.path) files->push_back(file.pds->data_path);
  }
  return std::move(file.info);
}

RasterInfo inspect_damaged_raster(const std::string& path) {
  RasterInfo info = describe_raster_file(path, {nullptr, Damage::describe}).info;
  if (info.damage.empty()) info.damage = "was being written when it was catalogued: start again when it is complete";
  return info;
}

struct Raster::Impl {
  explicit Impl(RasterFile f) : file(std::move(f)) {
    if (const auto* g = std::get_if<GeographicGrid>(&file.info.grid)) find_mirrors(*g);
  }

  // Finds the mirrors of a global raster: row r beyond a pole is row mirror - r on the opposite meridian. There are
  // none if a pole lies elsewhere than on a row or half-way between two, or if no column is opposite.
  void find_mirrors(const GeographicGrid& g) {
    const RasterInfo& info = file.info;
    if (!info.wraps_longitude || info.width % 2 != 0) return;
    const auto whole_number = [](double x) -> std::optional<std::int64_t> {
      return std::abs(x - std::round(x)) < 1e-6 ? std::optional<std::int64_t>(std::llround(x)) : std::nullopt;
    };
    north_mirror = whole_number(2 * (g.first_lat_deg - 90) * g.lat_posts_per_degree);
    south_mirror = whole_number(2 * (g.first_lat_deg + 90) * g.lat_posts_per_degree);
  }

  // Row of the file that shows at a row of posts.
  struct Row {
    std::int64_t row = -1;  // row of the file; -1: outside
    bool opposite = false;  // on the opposite meridian

    bool operator==(const Row&) const = default;
  };
  // Returns the row of the file that shows at row `y` of posts, which may lie outside the file.
  Row row_at(std::int64_t y) const {
    const std::int64_t height = file.info.height;
    if (y >= 0 && y < height) return {y, false};
    const auto& mirror = y < 0 ? north_mirror : south_mirror;
    if (!mirror) return {};
    const std::int64_t row = *mirror - y;
    return row >= 0 && row < height ? Row{row, true} : Row{};
  }

  // Reads posts that all lie in the file. `stride`: floats from one row of `out` to the next.
  void read_inside(int x, int y, int w, int h, float* out, std::size_t stride) {
    if (file.posts && !file.flip_x && !file.flip_y) return read_posts(file, x, y, w, h, out, stride);
    scratch.resize(static_cast<std::size_t>(w) * static_cast<std::size_t>(h));
    read_samples(file, file.flip_x ? file.file_width - x - w : x, file.flip_y ? file.file_height - y - h : y, w, h,
                 scratch.data());
    const double* sample = scratch.data();
    for (int j = 0; j < h; ++j)
      for (int i = 0; i < w; ++i, ++sample) {
        const auto row = static_cast<std::size_t>(file.flip_y ? h - 1 - j : j);
        const auto column = static_cast<std::size_t>(file.flip_x ? w - 1 - i : i);
        const double height_m = *sample * file.scale + file.offset_m;
        if (!is_void(file, *sample) && std::abs(height_m) <= kFarthestHeight_m)
          out[row * stride + column] = static_cast<float>(height_m);
      }
  }

  // Reads any columns of rows that lie in the file; columns wrap on a raster that wraps.
  void read_rows(std::int64_t x0, int y, int w, int h, float* out) {
    const std::int64_t width = file.info.width;
    const auto stride = static_cast<std::size_t>(w);
    if (!file.info.wraps_longitude) {
      const std::int64_t from = std::max<std::int64_t>(x0, 0), to = std::min(x0 + w, width);
      if (from < to) read_inside(static_cast<int>(from), y, static_cast<int>(to - from), h, out + (from - x0), stride);
      return;
    }
    for (std::int64_t done = 0; done < w;) {
      const std::int64_t x = ((x0 + done) % width + width) % width;
      const std::int64_t count = std::min(width - x, w - done);
      read_inside(static_cast<int>(x), y, static_cast<int>(count), h, out + done, stride);
      done += count;
    }
  }

  // Sets posts beyond the limb of an orthographic map to NaN: they are not the Moon.
  void remove_corners(int x0, int y0, int w, int h, float* heights_m) const {
    if (file.info.projection() != Projection::orthographic) return;
    const PlanePosts posts(std::get<PlaneGrid>(file.info.grid), file.info.width, file.info.height);
    const double x = x0, y = y0;
    if (posts.on_moon(x, y) && posts.on_moon(x + w, y) && posts.on_moon(x, y + h) && posts.on_moon(x + w, y + h))
      return;  // the disc is convex
    for (int j = 0; j < h; ++j)
      for (int i = 0; i < w; ++i, ++heights_m)
        if (!posts.on_moon(x + i, y + j)) *heights_m = std::numeric_limits<float>::quiet_NaN();
  }

  RasterFile file;
  std::optional<std::int64_t> north_mirror, south_mirror;  // find_mirrors(); empty: none
  std::vector<double> scratch;
};

Raster::Raster(const RasterInfo& info) {
  if (!info.damage.empty()) throw DataError(info.path, info.damage);
  RasterFile file = describe_raster_file(info.path, {&info, Damage::refuse});
  const RasterInfo& now = file.info;
  if (now.stamp != info.stamp || now.width != info.width || now.height != info.height)
    throw changed(info.path, "since it was catalogued");
  open_band(file);
  impl_ = std::make_unique<Impl>(std::move(file));
}

Raster::~Raster() = default;
Raster::Raster(Raster&&) noexcept = default;
Raster& Raster::operator=(Raster&&) noexcept = default;

const RasterInfo& Raster::info() const { return impl_->file.info; }

// Fills the rectangle with NaN, then reads the parts of it that the file has, in runs of consecutive rows.
void Raster::read(int x0, int y0, int w, int h, float* heights_m) {
  if (w <= 0 || h <= 0) return;
  const auto width = static_cast<std::size_t>(w);
  std::fill_n(heights_m, width * static_cast<std::size_t>(h), std::numeric_limits<float>::quiet_NaN());
  for (int j = 0; j < h;) {
    const Impl::Row row = impl_->row_at(static_cast<std::int64_t>(y0) + j);
    int count = 1;
    // Read consecutive rows of the file together; mirrored rows run backwards and are read one at a time.
    while (!row.opposite && row.row >= 0 && j + count < h &&
           impl_->row_at(static_cast<std::int64_t>(y0) + j + count) == Impl::Row{row.row + count, false})
      ++count;
    if (row.row >= 0) {
      const std::int64_t turn = row.opposite ? impl_->file.info.width / 2 : 0;
      impl_->read_rows(x0 + turn, static_cast<int>(row.row), w, count, heights_m + static_cast<std::size_t>(j) * width);
    }
    j += count;
  }
  impl_->remove_corners(x0, y0, w, h, heights_m);
  if (!current()) throw changed(info().path, "while it was open");
}

bool Raster::current() const { return is_current(impl_->file); }

}  // namespace selenograph::dem
