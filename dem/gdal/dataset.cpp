#include "dem/gdal/dataset.h"

#include <fmt/format.h>

#include <algorithm>
#include <cstdint>
#include <utility>

#include "dem/base/error.h"
#include "dem/gdal/remote_names.h"
#include "dem/gdal/vrt_sources.h"

namespace selenograph::dem {
namespace {

DatasetPtr try_to_open(const std::string& path, const char* const* drivers) {
  return DatasetPtr(static_cast<GDALDataset*>(
      GDALOpenEx(path.c_str(), GDAL_OF_RASTER | GDAL_OF_READONLY | GDAL_OF_VERBOSE_ERROR, drivers, nullptr, nullptr)));
}

// Returns the bytes of one block when decoded: of all bands if they are interleaved pixel by pixel.
std::uint64_t block_bytes(GDALRasterBand& band, int bands_per_block) {
  int width = 0, height = 0;
  band.GetBlockSize(&width, &height);
  return static_cast<std::uint64_t>(width) * static_cast<std::uint64_t>(height) *
         static_cast<std::uint64_t>(GDALGetDataTypeSizeBytes(band.GetRasterDataType())) *
         static_cast<std::uint64_t>(bands_per_block);
}

// Throws DataError if a block is too large: reading one sample decodes its whole block, and nothing can interrupt that.
// `whose`: owner_of() the source of a VRT, else empty.
void check_blocks(GDALDataset& dataset, CheckScope scope, const std::string& path, const std::string& whose) {
  const char* interleave = dataset.GetMetadataItem("INTERLEAVE", "IMAGE_STRUCTURE");
  const int bands_per_block = interleave && EQUAL(interleave, "PIXEL") ? dataset.GetRasterCount() : 1;
  const auto check = [&](GDALRasterBand* band, int bands) {
    const std::uint64_t bytes = band ? block_bytes(*band, bands) : 0;
    if (bytes > kBlockCache_bytes)
      throw DataError(path, fmt::format("one block of {}samples takes {} MiB decoded, more than {}: tile it, e.g. with "
                                        "gdal_translate -co TILED=YES",
                                        whose, bytes >> 20, kBlockCache_bytes >> 20));
  };
  for (int b = 1; b <= dataset.GetRasterCount(); ++b) {
    GDALRasterBand& band = *dataset.GetRasterBand(b);
    check(&band, bands_per_block);
    if (scope == CheckScope::again) continue;
    for (int i = 0; i < band.GetOverviewCount(); ++i) check(band.GetOverview(i), bands_per_block);
    check(mask_of(band), 1);
  }
}

// Returns the words that say, in an error about a block, whose samples it holds.
std::string owner_of(const std::string& source) { return "the source " + source + "'s "; }

std::vector<BandValues> bands_of(GDALDataset& source) {
  std::vector<BandValues> bands;
  for (int b = 1; b <= source.GetRasterCount(); ++b) bands.push_back(values_of(source, b));
  return bands;
}

}  // namespace

std::string BandValues::unit_name() const { return unit.empty() ? fmt::format("{:.9g} m", *vertical_m) : unit; }

BandValues values_of(GDALDataset& dataset, int band) {
  GDALRasterBand& values = *dataset.GetRasterBand(band);
  BandValues found{values.GetUnitType(), std::nullopt, values.GetScale(), values.GetOffset()};
  if (const OGRSpatialReference* srs = dataset.GetSpatialRef(); srs && srs->IsCompound())
    found.vertical_m = srs->GetTargetLinearUnits("COMPD_CS|VERT_CS");
  return found;
}

OpenDataset open_dataset(const std::string& path, const char* const* drivers, CheckScope scope) {
  register_gdal();
  OpenDataset open;
  // GDAL would parse such a name as the VRT's XML.
  if (path.find("<VRTDataset") != std::string::npos) throw DataError(path, "is not a file name");
  if (is_remote(path) && !is_allowed(path))
    throw DataError(path, "is not a file on this machine, and not allowed by --remote-prefix");
  VrtSources sources;
  if (!is_remote(path)) sources = vrt_sources(path);
  open.remote = is_remote(path) || std::any_of(sources.files.begin(), sources.files.end(), is_remote);
  const OpenOptions options(open.remote);
  const QuietGdal quiet;
  open.dataset = try_to_open(path, drivers);
  if (!open.dataset) quiet.fail(path, "cannot be opened", open.remote);
  check_blocks(*open.dataset, scope, path, "its ");
  open.rescales = sources.rescales;
  open.missing = std::move(sources.missing);
  if (scope == CheckScope::again) return open;
  for (const std::string& file : sources.files) {
    const DatasetPtr source = try_to_open(file, is_remote(file) ? kRemoteDrivers : kMapDrivers);
    if (!source && is_remote(file)) quiet.fail(file, "cannot be opened");
    // Skip a local source that cannot be opened: reading it later reports the error.
    if (!source) continue;
    check_blocks(*source, scope, path, owner_of(file));
    open.sources[file] = bands_of(*source);
  }
  return open;
}

GDALRasterBand* mask_of(GDALRasterBand& band) {
  return (band.GetMaskFlags() & GMF_PER_DATASET) != 0 ? band.GetMaskBand() : nullptr;
}

}  // namespace selenograph::dem
