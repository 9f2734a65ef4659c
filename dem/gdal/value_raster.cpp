#include "dem/gdal/value_raster.h"

#include <fmt/format.h>
#include <gdal_utils.h>
#include <unistd.h>

#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <filesystem>
#include <mutex>
#include <optional>
#include <utility>

#include "dem/base/error.h"
#include "dem/files/map_sphere.h"
#include "dem/gdal/dataset.h"
#include "dem/gdal/warp_rectangle.h"

namespace selenograph::dem {
namespace {

constexpr double kMaxDecoded_bytes = 1 << 30;  // largest file of which a decoded copy is made

// Returns the geographic coordinate system of `srs`, in degrees on its sphere, longitude first.
OGRSpatialReference degrees_like(const OGRSpatialReference& srs) {
  OGRSpatialReference degrees;
  degrees.CopyGeogCSFrom(&srs);
  degrees.SetAxisMappingStrategy(OAMS_TRADITIONAL_GIS_ORDER);
  return degrees;
}

// Returns true if every read decodes a file from its first row on, so that reading backwards starts again.
bool decodes_from_first_row(GDALDataset& dataset) {
  const std::string driver = dataset.GetDriverName();
  return driver == "JPEG" || driver == "PNG";
}

// Returns the bytes of all samples when decoded.
double decoded_bytes(GDALDataset& dataset) {
  const double pixels = static_cast<double>(dataset.GetRasterXSize()) * dataset.GetRasterYSize();
  double bytes = 0;
  for (int b = 1; b <= dataset.GetRasterCount(); ++b)
    bytes += pixels * GDALGetDataTypeSizeBytes(dataset.GetRasterBand(b)->GetRasterDataType());
  return bytes;
}

// New file in the temporary folder, unlinked with this object: an open handle can still read it. The name is empty if
// the file cannot be created.
class TemporaryFile {
 public:
  TemporaryFile() {
    std::error_code error;
    std::string name = (std::filesystem::temp_directory_path(error) / "selenograph-map-XXXXXX").string();
    const int fd = error ? -1 : ::mkstemp(name.data());
    if (fd < 0) return;
    ::close(fd);
    path_ = name;
  }
  ~TemporaryFile() {
    if (!path_.empty()) ::unlink(path_.c_str());
  }
  TemporaryFile(const TemporaryFile&) = delete;
  TemporaryFile& operator=(const TemporaryFile&) = delete;

  const std::string& path() const { return path_; }

 private:
  std::string path_;
};

// Returns a decoded, tiled copy of the dataset in an unlinked file. Null if it cannot be written, or if the dataset
// cannot be read: its next read then reports the error.
DatasetPtr decoded(GDALDataset& dataset) {
  const TemporaryFile file;
  if (file.path().empty()) return nullptr;
  CPLStringList words;
  for (const char* word : {"-of", "GTiff", "-co", "TILED=YES", "-co", "BIGTIFF=IF_SAFER"}) words.AddString(word);
  const QuietGdal quiet;
  CPLSetThreadLocalConfigOption("GDAL_TIFF_INTERNAL_MASK", "YES");
  GDALTranslateOptions* translate_options = GDALTranslateOptionsNew(words.List(), nullptr);
  DatasetPtr copy(static_cast<GDALDataset*>(GDALTranslate(file.path().c_str(), &dataset, translate_options, nullptr)));
  GDALTranslateOptionsFree(translate_options);
  CPLSetThreadLocalConfigOption("GDAL_TIFF_INTERNAL_MASK", nullptr);
  if (copy) copy->FlushCache(false);
  return CPLGetLastErrorType() >= CE_Failure ? nullptr : std::move(copy);
}

}  // namespace

struct ValueRaster::Impl {
  explicit Impl(const ValueMapOptions& options) : path(options.path), no_data(options.no_data), bands(options.bands) {
    const auto found = file_state(path);
    if (!found) throw DataError(path, "is missing or not a file");
    state = *found;
    dataset = open_dataset(path, kMapDrivers, CheckScope::first).dataset;
    if (decodes_from_first_row(*dataset) && decoded_bytes(*dataset) <= kMaxDecoded_bytes)
      if (DatasetPtr copy = decoded(*dataset)) dataset = std::move(copy);
    find_grid(options.extent);
    choose_bands();
  }

  // Sets the grid: by the extent that the user gives, else by the file's georeference.
  void find_grid(const std::optional<Footprint>& extent) {
    double t[6];  // west, pixel width, row rotation, north, column rotation, minus the pixel height
    const bool has_transform = dataset->GetGeoTransform(t) == CE_None;
    if (extent) {
      const int w = dataset->GetRasterXSize(), h = dataset->GetRasterYSize();
      grid = {extent->west_deg, extent->north_deg, (extent->east_deg - extent->west_deg) / w,
              (extent->north_deg - extent->south_deg) / h};
      return;
    }
    const OGRSpatialReference* srs = dataset->GetSpatialRef();
    if (!has_transform || !srs) throw DataError(path, "does not say where it lies: give its extent");
    const double semi_axes_m[] = {srs->GetSemiMajor(), srs->GetSemiMinor()};
    map_sphere_m(semi_axes_m, path);
    if (!srs->IsGeographic() || t[1] <= 0 || t[5] >= 0 || t[2] != 0 || t[4] != 0) warp(*srs);
    if (dataset->GetGeoTransform(t) != CE_None) throw DataError(path, "has no geotransform");
    grid = {t[0], t[3], t[1], -t[5]};
  }

  // Replaces the dataset by a view of it in degrees, which GDAL warps when it is read.
  void warp(const OGRSpatialReference& srs) {
    const OGRSpatialReference degrees = degrees_like(srs);
    char* wkt = nullptr;
    degrees.exportToWkt(&wkt);
    // Add alpha: pixels of the warped rectangle outside the raster are no values.
    CPLStringList words;
    for (const char* word : {"-of", "VRT", "-t_srs", static_cast<const char*>(wkt), "-dstalpha", "-r", "bilinear"})
      words.AddString(word);
    if (const auto r = warp_rectangle(*dataset, srs, degrees)) {
      const auto add = [&](const auto&... word) { (words.AddString(fmt::format("{}", word).c_str()), ...); };
      add("-te", r->west_deg, r->south_deg, r->east_deg, r->north_deg, "-ts", r->width, r->height);
      // Take one sample per pixel. GDAL would derive the number from the sizes of a block and of its bounding box in
      // the raster. That box is far larger if the block is part of a ring around the pole.
      add("-wo", "XSCALE=1", "-wo", "YSCALE=1");
    }
    const QuietGdal quiet;
    GDALWarpAppOptions* warp_options = GDALWarpAppOptionsNew(words.List(), nullptr);
    GDALDatasetH source = dataset.get();
    auto* warped = static_cast<GDALDataset*>(GDALWarp("", nullptr, 1, &source, warp_options, nullptr));
    GDALWarpAppOptionsFree(warp_options);
    CPLFree(wkt);
    if (!warped) quiet.fail(path, "cannot be warped to degrees");
    unwarped = std::move(dataset);
    dataset.reset(warped);
  }

  void choose_bands() {
    if (bands.empty())
      for (int b = 1; b <= dataset->GetRasterCount(); ++b)
        if (dataset->GetRasterBand(b)->GetColorInterpretation() != GCI_AlphaBand) bands.push_back(b);
    for (const int b : bands)
      if (b < 1 || b > dataset->GetRasterCount())
        throw DataError(path, fmt::format("has no band {}, only {}", b, dataset->GetRasterCount()));
    if (bands.empty()) throw DataError(path, "has no band of values");
  }

  bool current() const { return file_state(path) == state; }

  // Reads one band's samples and its mask (0: void). The mask stays unchanged if all samples are valid.
  void read_band(int b, int overview, const Window& w, double* samples, std::uint8_t* mask) const {
    const QuietGdal quiet;
    GDALRasterBand* band = dataset->GetRasterBand(b);
    if (overview >= 0) band = band->GetOverview(overview);
    if (!band || band->RasterIO(GF_Read, w.x, w.y, w.width, w.height, samples, w.width, w.height, GDT_Float64, 0, 0,
                                nullptr) != CE_None)
      quiet.fail(path, "cannot be read");
    // Read NoData, alpha or a mask, whichever the file has.
    if ((band->GetMaskFlags() & GMF_ALL_VALID) == 0 &&
        band->GetMaskBand()->RasterIO(GF_Read, w.x, w.y, w.width, w.height, mask, w.width, w.height, GDT_Byte, 0, 0,
                                      nullptr) != CE_None)
      quiet.fail(path, "its mask cannot be read");
  }

  std::string path;
  std::optional<double> no_data;
  std::vector<int> bands;
  FileState state;
  DatasetPtr unwarped, dataset;  // `dataset` may be a warped view of `unwarped`, and is destroyed first
  Grid grid{};
  mutable std::mutex mutex;  // a GDAL dataset may be used by one thread at a time
};

ValueRaster::ValueRaster(const ValueMapOptions& options) : impl_(std::make_unique<Impl>(options)) {}
ValueRaster::~ValueRaster() = default;

int ValueRaster::width() const { return impl_->dataset->GetRasterXSize(); }
int ValueRaster::height() const { return impl_->dataset->GetRasterYSize(); }
const ValueRaster::Grid& ValueRaster::grid() const { return impl_->grid; }
const std::vector<int>& ValueRaster::bands() const { return impl_->bands; }
const FileState& ValueRaster::state() const { return impl_->state; }
bool ValueRaster::current() const { return impl_->current(); }

int ValueRaster::overview_of_size(int width, int height) const {
  GDALRasterBand& band = *impl_->dataset->GetRasterBand(impl_->bands[0]);
  // Prefer the last overview of several of that size.
  for (int i = band.GetOverviewCount() - 1; i >= 0; --i)
    if (GDALRasterBand* overview = band.GetOverview(i))
      if (overview->GetXSize() == width && overview->GetYSize() == height) return i;
  return -1;
}

// Averages the bands; a texel that is void in one of them is void.
void ValueRaster::read(int overview, const Window& w, int stride, double* out) const {
  const auto size = static_cast<std::size_t>(w.width) * static_cast<std::size_t>(w.height);
  std::vector<double> samples(size), sum(size, 0);
  std::vector<std::uint8_t> mask(size, 255);
  const std::lock_guard lock(impl_->mutex);
  for (const int b : impl_->bands) {
    impl_->read_band(b, overview, w, samples.data(), mask.data());
    GDALRasterBand& band = *impl_->dataset->GetRasterBand(b);
    const double scale = band.GetScale(), offset = band.GetOffset();
    for (std::size_t i = 0; i < size; ++i) {
      const double s = samples[i];
      const bool is_void = mask[i] == 0 || !std::isfinite(s) || (impl_->no_data && s == *impl_->no_data);
      sum[i] += is_void ? std::nan("") : s * scale + offset;
    }
  }
  // Check after reading, so that a change during the read shows, too.
  if (!impl_->current()) throw DataError(impl_->path, "has changed since it was opened");
  for (int y = 0; y < w.height; ++y)
    for (int x = 0; x < w.width; ++x)
      out[static_cast<std::size_t>(y) * static_cast<std::size_t>(stride) + static_cast<std::size_t>(x)] =
          sum[static_cast<std::size_t>(y * w.width + x)] / static_cast<double>(impl_->bands.size());
}

}  // namespace selenograph::dem
