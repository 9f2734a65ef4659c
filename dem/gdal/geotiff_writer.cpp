#include "dem/gdal/geotiff_writer.h"

#include <cpl_vsi.h>
#include <fmt/format.h>

#include <algorithm>
#include <atomic>
#include <cmath>
#include <limits>
#include <memory>
#include <stdexcept>
#include <vector>

#include "dem/base/error.h"
#include "dem/files/whole_file.h"
#include "dem/gdal/library.h"
#include "dem/grid/geodesy.h"

namespace selenograph::dem {
namespace {

// Returns GDAL's last message, as the reason why a file cannot be written.
std::string complaint() {
  const std::string text = CPLGetLastErrorMsg();
  return text.empty() ? "cannot be written" : text;
}

// Returns latitude and longitude on the IAU's mean sphere, with the names of the IAU's own definitions
// (IAU_2015:30100), so that a GIS finds the match.
OGRSpatialReference moon() {
  OGRSpatialReference srs;
  srs.SetGeogCS("Moon (2015) - Sphere / Ocentric", "Moon (2015) - Sphere", "Moon (2015) - Sphere", kMoonRadius_m, 0,
                "Reference Meridian", 0);
  srs.SetAxisMappingStrategy(OAMS_TRADITIONAL_GIS_ORDER);
  return srs;
}

// Sets georeference, void value, name and unit of a grid of heights.
void describe(GDALDataset& dataset, const GeotiffGrid& g, const std::string& name, const std::string& path) {
  // Start at the outer corner of the first pixel.
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

// Writes a grid of heights in degrees to a file of GDAL's.
void create(const std::string& path, const GeotiffGrid& g, std::span<const float> values, const std::string& name) {
  if (g.width < 1 || g.height < 1 ||
      values.size() != static_cast<std::size_t>(g.width) * static_cast<std::size_t>(g.height))
    throw std::invalid_argument("a grid's values do not match its size");
  register_gdal();
  const QuietGdal quiet;
  const char* const options[] = {"COMPRESS=DEFLATE", "PREDICTOR=3", "BIGTIFF=IF_SAFER", nullptr};
  GDALDriver* driver = GetGDALDriverManager()->GetDriverByName("GTiff");
  const DatasetPtr dataset(
      driver->Create(path.c_str(), g.width, g.height, 1, GDT_Float32, const_cast<char**>(options)));
  if (!dataset) throw DataError(path, complaint());
  describe(*dataset, g, name, path);
  // Cast const away: GDAL's signature lacks it, but writing does not change the values.
  const CPLErr written =
      dataset->GetRasterBand(1)->RasterIO(GF_Write, 0, 0, g.width, g.height, const_cast<float*>(values.data()), g.width,
                                          g.height, GDT_Float32, 0, 0, nullptr);
  dataset->FlushCache(true);
  if (written != CE_None || CPLGetLastErrorType() >= CE_Failure) throw DataError(path, complaint());
}

// --- maps

constexpr int kTile = 256;
// Returns the tiles' height, at most a low map's; their sides are multiples of 16.
int tile_height(const MapGrid& grid) { return std::min(kTile, (grid.height + 15) / 16 * 16); }

// Returns the coordinate system of a map, named as in the IAU's own definitions (IAU_2015:30110 to 30135), which differ
// in parameters only.
OGRSpatialReference moon(const MapPlane& plane) {
  OGRSpatialReference srs = moon();
  const std::string name = "Moon (2015) - Sphere / Ocentric / ",
                    origin = fmt::format("clat = {:g}, clon = {:g}", plane.lat_deg, plane.lon_deg);
  switch (plane.projection) {
    case MapProjection::equirectangular:
      srs.SetProjCS((name + fmt::format("Equirectangular, clon = {:g}", plane.lon_deg)).c_str());
      srs.SetEquirectangular2(0, plane.lon_deg, plane.standard_parallel_deg, 0, 0);
      break;
    case MapProjection::stereographic:
      if (std::abs(plane.lat_deg) == 90) {
        srs.SetProjCS((name + (plane.lat_deg > 0 ? "North Polar" : "South Polar")).c_str());
        srs.SetPS(plane.lat_deg, plane.lon_deg, plane.scale, 0, 0);
      } else {
        srs.SetProjCS((name + "Stereographic, " + origin).c_str());
        srs.SetStereographic(plane.lat_deg, plane.lon_deg, plane.scale, 0, 0);
      }
      break;
    case MapProjection::orthographic:
      srs.SetProjCS((name + "Orthographic, " + origin).c_str());
      srs.SetOrthographic(plane.lat_deg, plane.lon_deg, 0, 0);
      break;
    case MapProjection::mercator:
      srs.SetProjCS((name + fmt::format("Mercator, clon = {:g}", plane.lon_deg)).c_str());
      srs.SetMercator(0, plane.lon_deg, plane.scale, 0, 0);
      break;
    case MapProjection::transverse_mercator:
      srs.SetProjCS((name + "Transverse Mercator, " + origin).c_str());
      srs.SetTM(plane.lat_deg, plane.lon_deg, plane.scale, 0, 0);
      break;
  }
  return srs;
}

// Returns the type of a file's samples, which can hold the elements of all bands.
GDALDataType type_of(std::span<const MapBand> bands) {
  GDALDataType widest = GDT_UInt16;
  for (const MapBand& band : bands) {
    if (std::holds_alternative<const double*>(band.values)) return GDT_Float64;
    if (std::holds_alternative<const float*>(band.values)) widest = GDT_Float32;
  }
  return widest;
}

// Sets georeference and metadata of a map, and void value, name and unit of its bands.
void describe(GDALDataset& dataset, const MapGrid& grid, std::span<const MapBand> bands, const std::string& metadata,
              const std::string& path) {
  std::array<double, 6> transform = geotransform_of(grid);
  const OGRSpatialReference srs = moon(grid.plane);
  const double no_data = type_of(bands) == GDT_UInt16 ? kNoMapNumber : std::numeric_limits<double>::quiet_NaN();
  bool done = dataset.SetGeoTransform(transform.data()) == CE_None && dataset.SetSpatialRef(&srs) == CE_None &&
              dataset.SetMetadataItem("SELENOGRAPH", metadata.c_str()) == CE_None;
  for (std::size_t i = 0; i < bands.size(); ++i) {
    GDALRasterBand* band = dataset.GetRasterBand(static_cast<int>(i) + 1);
    done &= band->SetNoDataValue(no_data) == CE_None;
    band->SetDescription(bands[i].name.c_str());
    if (!bands[i].unit.empty()) band->SetUnitType(bands[i].unit.c_str());
  }
  if (!done) throw DataError(path, complaint());
}

// Rectangle of a map's pixels.
struct Window {
  int column, row, columns, rows;
};

// Copies a band's elements in a window to `out`, as double. `among_floats`: converts kNoMapNumber to NaN.
void widen(const MapBand& band, const MapGrid& grid, const Window& window, bool among_floats,
           std::vector<double>& out) {
  out.clear();
  const auto step = static_cast<std::ptrdiff_t>(band.step);
  std::visit(
      [&](const auto* values) {
        for (int r = 0; r < window.rows; ++r) {
          const auto* from = values + (std::ptrdiff_t{window.row + r} * grid.width + window.column) * step;
          for (int c = 0; c < window.columns; ++c, from += step) out.push_back(static_cast<double>(*from));
        }
      },
      band.values);
  if (!among_floats || !std::holds_alternative<const std::uint16_t*>(band.values)) return;
  for (double& value : out)
    if (value == kNoMapNumber) value = std::numeric_limits<double>::quiet_NaN();
}

// Calls visit(window) for windows of whole tiles, a few megabytes each.
template <typename Visit>
void for_each_window(const MapGrid& grid, const Visit& visit) {
  constexpr int kColumns = 8 * kTile;
  for (int row = 0; row < grid.height; row += kTile)
    for (int column = 0; column < grid.width; column += kColumns)
      visit(Window{column, row, std::min(kColumns, grid.width - column), std::min(kTile, grid.height - row)});
}

// Writes the bands of a map to a file of GDAL's, window by window.
void create(const std::string& path, const MapGrid& grid, std::span<const MapBand> bands, const std::string& metadata,
            const StopToken& stop) {
  register_gdal();
  const QuietGdal quiet;
  const GDALDataType type = type_of(bands);
  const std::string height = fmt::format("BLOCKYSIZE={}", tile_height(grid));
  const char* const options[] = {"TILED=YES",
                                 height.c_str(),
                                 "COMPRESS=DEFLATE",
                                 "ZLEVEL=1",
                                 "NUM_THREADS=ALL_CPUS",  // the number of threads does not change the bytes
                                 "INTERLEAVE=BAND",
                                 "BIGTIFF=IF_SAFER",
                                 type == GDT_UInt16 ? "PREDICTOR=2" : "PREDICTOR=3",
                                 nullptr};
  GDALDriver* driver = GetGDALDriverManager()->GetDriverByName("GTiff");
  const DatasetPtr dataset(driver->Create(path.c_str(), grid.width, grid.height, static_cast<int>(bands.size()), type,
                                          const_cast<char**>(options)));
  if (!dataset) throw DataError(path, complaint());
  describe(*dataset, grid, bands, metadata, path);
  std::vector<double> values;
  CPLErr written = CE_None;
  for (std::size_t i = 0; i < bands.size(); ++i) {
    GDALRasterBand* band = dataset->GetRasterBand(static_cast<int>(i) + 1);
    for_each_window(grid, [&](const Window& w) {
      if (written != CE_None) return;
      stop.check();
      widen(bands[i], grid, w, type != GDT_UInt16, values);
      written = band->RasterIO(GF_Write, w.column, w.row, w.columns, w.rows, values.data(), w.columns, w.rows,
                               GDT_Float64, 0, 0, nullptr);
      band->FlushCache(false);  // compress now, so that `stop` is checked between windows
    });
  }
  dataset->FlushCache(true);
  if (written != CE_None || CPLGetLastErrorType() >= CE_Failure) throw DataError(path, complaint());
}

// Returns the bytes that write(path) leaves in the memory file at `path`.
template <typename Write>
std::string in_memory(const Write& write) {
  static std::atomic<unsigned> made{0};
  const std::string path = fmt::format("/vsimem/selenograph/{}.tif", made++);
  struct Unlink {
    const std::string& path;
    ~Unlink() { VSIUnlink(path.c_str()); }
  } const unlink{path};
  write(path);
  vsi_l_offset size = 0;
  const GByte* bytes = VSIGetMemFileBuffer(path.c_str(), &size, FALSE);
  if (!bytes) throw DataError(path, complaint());
  return {reinterpret_cast<const char*>(bytes), static_cast<std::size_t>(size)};
}

}  // namespace

void write_geotiff(const std::string& path, const GeotiffGrid& grid, std::span<const float> values,
                   const std::string& name) {
  write_whole_file(path, geotiff_bytes(grid, values, name));
}

std::string geotiff_bytes(const GeotiffGrid& grid, std::span<const float> values, const std::string& name) {
  return in_memory([&](const std::string& path) { create(path, grid, values, name); });
}

std::string wkt_of(const MapPlane& plane) {
  register_gdal();
  const QuietGdal quiet;
  const char* const options[] = {"FORMAT=WKT2_2019", "MULTILINE=NO", nullptr};
  char* text = nullptr;
  const OGRErr failed = moon(plane).exportToWkt(&text, options);
  const std::string wkt = text ? text : "";
  CPLFree(text);
  if (failed != OGRERR_NONE) throw std::runtime_error("a map's coordinate system: " + complaint());
  return wkt;
}

std::array<double, 6> geotransform_of(const MapGrid& g) { return {g.west_m, g.gsd_m, 0, g.north_m, 0, -g.gsd_m}; }

std::string geotiff_bytes(const MapGrid& grid, std::span<const MapBand> bands, const std::string& metadata,
                          const StopToken& stop) {
  return in_memory([&](const std::string& path) { create(path, grid, bands, metadata, stop); });
}

std::size_t geotiff_bytes_at_most(const MapGrid& grid, std::span<const MapBand> bands) {
  const std::size_t element = type_of(bands) == GDT_Float64 ? 8 : type_of(bands) == GDT_Float32 ? 4 : 2;
  const auto tiles = [](int pixels, int side) { return static_cast<std::size_t>((pixels + side - 1) / side * side); };
  // Add 1 % for samples that do not compress, and 8 MiB for a window in double and metadata.
  return bands.size() * element * tiles(grid.width, kTile) * tiles(grid.height, tile_height(grid)) * 101 / 100 +
         (std::size_t{8} << 20);
}

}  // namespace selenograph::dem
