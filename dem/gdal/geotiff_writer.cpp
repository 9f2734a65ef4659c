#include "dem/gdal/geotiff_writer.h"

#include <cpl_vsi.h>
#include <fmt/format.h>
#include <unistd.h>

#include <atomic>
#include <filesystem>
#include <limits>
#include <memory>
#include <stdexcept>
#include <system_error>

#include "dem/error.h"
#include "dem/gdal/library.h"
#include "dem/geodesy.h"

namespace selenograph::dem {
namespace {

namespace fs = std::filesystem;

std::string complaint() {
  const std::string text = CPLGetLastErrorMsg();
  return text.empty() ? "can't be written" : text;
}

// Latitude and longitude on the IAU's mean sphere, the names as in the IAU's own definitions (IAU_2015:30100), so that
// a GIS finds the match.
OGRSpatialReference moon() {
  OGRSpatialReference srs;
  srs.SetGeogCS("Moon (2015) - Sphere / Ocentric", "Moon (2015) - Sphere", "Moon (2015) - Sphere", kMoonRadius_m, 0,
                "Reference Meridian", 0);
  srs.SetAxisMappingStrategy(OAMS_TRADITIONAL_GIS_ORDER);
  return srs;
}

void describe(GDALDataset& dataset, const GeotiffGrid& g, const std::string& name, const std::string& path) {
  // From the outer corner of the first pixel.
  double transform[] = {
      g.west_deg - g.lon_step_deg / 2, g.lon_step_deg, 0, g.north_deg + g.lat_step_deg / 2, 0, -g.lat_step_deg};
  const OGRSpatialReference srs = moon();
  GDALRasterBand* band = dataset.GetRasterBand(1);
  const bool done = dataset.SetGeoTransform(transform) == CE_None && dataset.SetSpatialRef(&srs) == CE_None &&
                    band->SetNoDataValue(std::numeric_limits<double>::quiet_NaN()) == CE_None;
  if (!done) throw DataError(path, complaint());
  band->SetDescription(name.c_str());
  band->SetUnitType("m");
}

void create(const std::string& path, const GeotiffGrid& g, std::span<const float> values, const std::string& name) {
  if (g.width < 1 || g.height < 1 ||
      values.size() != static_cast<std::size_t>(g.width) * static_cast<std::size_t>(g.height))
    throw std::invalid_argument("a grid's values don't match its size");
  register_gdal();
  const QuietGdal quiet;
  const char* const options[] = {"COMPRESS=DEFLATE", "PREDICTOR=3", "BIGTIFF=IF_SAFER", nullptr};
  GDALDriver* driver = GetGDALDriverManager()->GetDriverByName("GTiff");
  const DatasetPtr dataset(
      driver->Create(path.c_str(), g.width, g.height, 1, GDT_Float32, const_cast<char**>(options)));
  if (!dataset) throw DataError(path, complaint());
  describe(*dataset, g, name, path);
  // GDAL takes what it writes as not const, and doesn't change it.
  const CPLErr written =
      dataset->GetRasterBand(1)->RasterIO(GF_Write, 0, 0, g.width, g.height, const_cast<float*>(values.data()), g.width,
                                          g.height, GDT_Float32, 0, 0, nullptr);
  dataset->FlushCache(true);
  if (written != CE_None || CPLGetLastErrorType() >= CE_Failure) throw DataError(path, complaint());
}

}  // namespace

void write_geotiff(const std::string& path, const GeotiffGrid& grid, std::span<const float> values,
                   const std::string& name) {
  const std::string temporary = fmt::format("{}.part-{}", path, ::getpid());
  std::error_code error;
  try {
    create(temporary, grid, values, name);
  } catch (...) {
    fs::remove(temporary, error);
    throw;
  }
  fs::rename(temporary, path, error);
  if (!error) return;
  const std::string why = error.message();
  fs::remove(temporary, error);
  throw DataError(path, why);
}

std::string geotiff_bytes(const GeotiffGrid& grid, std::span<const float> values, const std::string& name) {
  static std::atomic<unsigned> made{0};
  const std::string path = fmt::format("/vsimem/selenograph/{}.tif", made++);
  struct Unlink {
    const std::string& path;
    ~Unlink() { VSIUnlink(path.c_str()); }
  } const unlink{path};
  create(path, grid, values, name);
  vsi_l_offset size = 0;
  const GByte* bytes = VSIGetMemFileBuffer(path.c_str(), &size, FALSE);
  if (!bytes) throw DataError(path, complaint());
  return {reinterpret_cast<const char*>(bytes), static_cast<std::size_t>(size)};
}

}  // namespace selenograph::dem
