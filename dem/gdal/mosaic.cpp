#include "dem/gdal/mosaic.h"

#include <gdal_utils.h>

#include <filesystem>
#include <vector>

#include "dem/base/error.h"
#include "dem/gdal/library.h"

namespace selenograph::dem {
namespace {

DatasetPtr open_map(const std::string& path) {
  DatasetPtr dataset(GDALDataset::Open(path.c_str(), GDAL_OF_RASTER | GDAL_OF_READONLY, kMapDrivers));
  if (!dataset) throw DataError(path, CPLGetLastErrorMsg());
  return dataset;
}

// Gives a mosaic the names and units of a file's bands, which GDAL leaves out.
void copy_names(GDALDataset& from, GDALDataset& to) {
  for (int i = 1; i <= from.GetRasterCount(); ++i) {
    to.GetRasterBand(i)->SetDescription(from.GetRasterBand(i)->GetDescription());
    to.GetRasterBand(i)->SetUnitType(from.GetRasterBand(i)->GetUnitType());
  }
}

}  // namespace

void write_mosaic(const std::string& path, std::span<const std::string> files) {
  register_gdal();
  const QuietGdal quiet;
  std::vector<const char*> names;
  for (const std::string& file : files) names.push_back(file.c_str());
  const std::string unfinished = path + ".part.vrt";
  {
    const DatasetPtr mosaic(GDALDataset::FromHandle(
        GDALBuildVRT(unfinished.c_str(), static_cast<int>(names.size()), nullptr, names.data(), nullptr, nullptr)));
    if (!mosaic) throw DataError(path, CPLGetLastErrorMsg());
    copy_names(*open_map(files.front()), *mosaic);
  }
  std::filesystem::rename(unfinished, path);
}

}  // namespace selenograph::dem
