#include "dem/gdal/raster_file.h"

#include <fcntl.h>
#include <fmt/format.h>

#include <algorithm>
#include <bit>
#include <cerrno>
#include <cmath>
#include <filesystem>
#include <limits>

#include "dem/base/error.h"
#include "dem/base/hash.h"
#include "dem/base/names.h"
#include "dem/files/files.h"
#include "dem/files/labels.h"
#include "dem/files/map_sphere.h"
#include "dem/gdal/dataset.h"
#include "dem/gdal/georeference.h"
#include "dem/gdal/height_evidence.h"
#include "dem/gdal/remote_names.h"

namespace selenograph::dem {
namespace {

namespace fs = std::filesystem;

constexpr double kUndeclaredVoid =
    1e30;  // samples from this size on are voids: a DUMMY such as -3.4e38 that the label forgot
constexpr double kNoRadiusBelow_m =
    1.6e6;  // limit between heights, within 11 km of zero, and radii, within 11 km of 1737.4 km
constexpr const char* kHeightDatum = "sphere 1737.4 km, height";
constexpr const char* kRadiusDatum = "planetary radius, converted";

// Returns a file's state. Throws DataError that names the file `named`, which refers to it, if it is missing.
FileState must_exist(const std::string& path, const std::string& named) {
  if (const auto state = file_state(path)) return *state;
  throw DataError(named, path == named ? "is missing or not a file" : "its file " + path + " is missing");
}

// Returns the length and the time of a remote file as its server reports them.
FileState remote_state(const std::string& path) {
  const OpenOptions options(true);
  const QuietGdal quiet;
  VSIStatBufL found{};
  constexpr int kAll = VSI_STAT_EXISTS_FLAG | VSI_STAT_NATURE_FLAG | VSI_STAT_SIZE_FLAG | VSI_STAT_SET_ERROR_FLAG;
  if (VSIStatExL(path.c_str(), &found, kAll) != 0) quiet.fail(path, "cannot be read from its server");
  return {static_cast<std::uint64_t>(found.st_size), static_cast<std::int64_t>(found.st_mtime) * 1'000'000'000};
}

bool is_integer(GDALDataType type) { return GDALDataTypeIsInteger(type) != 0; }

GDALDataType gdal_type(const RawSample& s) {
  if (s.real) return s.bytes == 4 ? GDT_Float32 : GDT_Float64;
  if (s.bytes == 2) return s.has_sign ? GDT_Int16 : GDT_UInt16;
  return s.has_sign ? GDT_Int32 : GDT_UInt32;
}

// Throws DataError if the data file was truncated: GDAL would fill the missing end of a raw file with zeros.
void check_still_there(const RasterFile& s) {
  if (!s.pds) return;
  const auto state = file_state(s.pds->data_path);
  if (!state || state->bytes < s.pds->bytes_needed)
    throw DataError(s.info.path, "its data file " + s.pds->data_path + (state ? " was truncated" : " vanished"));
}

bool may_be_height(double value_m) { return std::abs(value_m) <= kFarthestHeight_m; }
bool may_be_radius(double value_m) { return std::abs(value_m - kMoonRadius_m) <= kFarthestHeight_m; }
bool is_possible(double value_m) { return may_be_height(value_m) || may_be_radius(value_m); }

// Returns heights of kSamples evenly spread posts, without voids.
constexpr int kAcross = 6, kSamples = kAcross * kAcross;  // posts per side of a sparse grid, and in all
std::vector<double> sample_heights(RasterFile& s) {
  open_band(s);
  std::vector<double> heights;
  for (int i = 0; i < kSamples; ++i) {
    // Returns the middle of part k of kAcross equal parts of n posts.
    const auto pick = [](int n, int k) { return static_cast<int>((2LL * k + 1) * n / (2 * kAcross)); };
    double sample = 0;
    read_samples(s, pick(s.file_width, i % kAcross), pick(s.file_height, i / kAcross), 1, 1, &sample);
    if (!is_void(s, sample)) heights.push_back(sample * s.scale + s.offset_m);
  }
  return heights;
}

// Returns true if the samples are radii. The offset decides; else, if the type can hold a radius at all, a few samples
// do. Each number counts once, since a void that the label does not declare, such as 0 or 1750000, is the same number
// everywhere. A level file's only height or radius also is: then all samples count.
bool holds_radii(RasterFile& s) {
  if (s.offset_m > kNoRadiusBelow_m) return true;
  const bool narrow = is_integer(s.type) && GDALGetDataTypeSizeBytes(s.type) <= 2;
  if (narrow && std::abs(s.scale) * 65535 + s.offset_m < kNoRadiusBelow_m) return false;
  std::vector<double> heights = sample_heights(s);
  if (heights.empty()) return false;
  const auto impossible = [&](double height_m) {
    return std::abs((height_m - s.offset_m) / s.scale) < kUndeclaredVoid && !is_possible(height_m);
  };
  if (std::count_if(heights.begin(), heights.end(), impossible) == kSamples)
    throw DataError(s.info.path, "its samples cannot be heights: " + std::to_string(heights.front()) + " m is one");
  const auto more_radii = [&] {
    return std::count_if(heights.begin(), heights.end(), may_be_radius) -
           std::count_if(heights.begin(), heights.end(), may_be_height);
  };
  const auto excess_of_samples = more_radii();
  std::sort(heights.begin(), heights.end());
  heights.erase(std::unique(heights.begin(), heights.end()), heights.end());
  const auto excess_of_values = more_radii();
  return excess_of_values != 0 ? excess_of_values > 0 : excess_of_samples > 0;
}

// Returns the reason why samples times scale plus offset cannot be heights or radii of the Moon; empty if they can.
// Such a file would show as a hole, or a plain, without an explanation.
std::string impossible_values(const RasterFile& s) {
  // Limits of one step of the samples. Floats may be in units from the radius down to nanometres.
  constexpr double kFinestStep_m = 1e-9, kCoarsestStep_m = 1e4, kLargestUnit_m = 2e6, kFarthest_m = 1e7;
  const double step = std::abs(s.scale);
  const auto value = [](double x) { return std::to_string(x); };
  if (!(step >= kFinestStep_m && step <= (is_integer(s.type) ? kCoarsestStep_m : kLargestUnit_m)))
    return "its scale makes heights impossible: one step of its samples is " + value(s.scale) + " m";
  if (!(std::abs(s.offset_m) <= kFarthest_m))
    return "its offset of " + value(s.offset_m) + " m makes heights impossible";
  if (!is_integer(s.type)) return {};
  // Convert the range of the sample type to metres.
  const int bits = 8 * GDALGetDataTypeSizeBytes(s.type);
  const bool has_sign = s.type == GDT_Int16 || s.type == GDT_Int32;
  const double min_sample = has_sign ? -std::ldexp(1.0, bits - 1) : 0,
               max_sample = std::ldexp(1.0, has_sign ? bits - 1 : bits) - 1;
  const auto range = std::minmax({min_sample * s.scale + s.offset_m, max_sample * s.scale + s.offset_m});
  const double low = range.first, high = range.second;  // Clang 14's lambdas capture no structured bindings
  const auto intersects = [&](double from, double to) { return low <= to && high >= from; };
  if (intersects(-kFarthestHeight_m, kFarthestHeight_m) ||
      intersects(kMoonRadius_m - kFarthestHeight_m, kMoonRadius_m + kFarthestHeight_m))
    return {};
  return "its scale and offset make all heights impossible: " + value(low) + " to " + value(high) + " m";
}

// Sets the datum and quantisation. `inspected`: result of an earlier inspection, so that opening need not read samples
// again; or null.
void find_datum(RasterFile& s, double sphere_m, const RasterInfo* inspected) {
  if (!inspected)
    if (const std::string wrong = impossible_values(s); !wrong.empty()) throw DataError(s.info.path, wrong);
  const bool radii = inspected ? inspected->datum == kRadiusDatum : holds_radii(s);
  if (!inspected) check_vertical_datum(sphere_m, radii, s.info.path);
  if (radii) s.offset_m -= kMoonRadius_m;
  s.info.datum = radii ? kRadiusDatum : kHeightDatum;
  s.info.quantisation_m = is_integer(s.type) ? std::abs(s.scale) : 0;
}

// Sets datum and voids. With Damage::describe, an unknown datum becomes damage: no request reads such a file's posts.
void resolve_values(RasterFile& s, double sphere_m, const RasterReading& reading) {
  try {
    if (s.info.damage.empty()) find_datum(s, sphere_m, reading.inspected);
  } catch (const DataError& error) {
    if (reading.damage == Damage::refuse) throw;
    s.info.damage = error.what_is_wrong();
  }
  if (!s.info.damage.empty()) s.info.datum = kHeightDatum;
  if (!s.voids.empty()) s.info.void_value = s.voids.front();
}

// Sets the raster's grid. Throws DataError for a single row or column: terrain consists of triangles between posts.
void set_post_grid(RasterInfo& info, const PostGrid& grid) {
  if (info.width < 2 || info.height < 2) throw DataError(info.path, "is a single row or column of posts: no surface");
  set_grid(info, grid);
}

// Throws NotHeights if the data file has a better label: one of its own name that also names it. LDEM_4.LBL and
// LDEM_4_JP2.LBL, for example, place LDEM_4.IMG 180 degrees apart.
void check_label_is_its_own(const std::string& label_path, const std::string& data_path) {
  if (same_text(stem_of(name_of(label_path)), stem_of(name_of(data_path)))) return;
  const std::optional<std::string> own = label_of(data_path);
  if (!own || *own == data_path || *own == label_path) return;
  const std::vector<std::string> named = files_named_by(*own);
  const std::string data_name = lower(name_of(data_path));
  if (std::find(named.begin(), named.end(), data_name) != named.end())
    throw NotHeights(label_path, fmt::format("describes {}, whose own label is {}", name_of(data_path), name_of(*own)));
}

// Describes a raw image by its label (PDS3).
RasterFile describe_labelled_file(const std::string& label_path, const RasterReading& reading) {
  const FileState label = must_exist(label_path, label_path);
  const RawImage image = describe_labelled(label_path);
  check_label_is_its_own(label_path, image.data_path);
  if (!reading.inspected)
    check_words(label_path, {{image.quantity, "its label"}}, {label_path, image.data_path, image.product});
  if (image.row_bytes > std::numeric_limits<int>::max()) throw DataError(label_path, "its rows are too long");
  const bool gone = reading.damage == Damage::describe && !file_state(image.data_path);
  const FileState data = gone ? FileState{} : must_exist(image.data_path, label_path);

  RasterFile s;
  s.info.path = label_path;
  s.info.name = fs::path(label_path).stem().string();
  s.info.format = image.format;
  s.info.synthetic = image.synthetic;
  s.info.width = s.file_width = image.width;
  s.info.height = s.file_height = image.height;
  s.info.bytes = data.bytes;
  s.info.modified_ns = std::max(label.modified_ns, data.modified_ns);
  s.files.push_back({label_path, label});
  if (!gone && image.data_path != label_path) s.files.push_back({image.data_path, data});
  s.type = gdal_type(image.sample);
  s.scale = image.scale * image.unit_m;
  s.offset_m = image.offset * image.unit_m;
  s.voids = image.voids;
  const std::uint64_t last_row =
      static_cast<std::uint64_t>(image.width) * static_cast<std::uint64_t>(image.sample.bytes);
  const std::uint64_t needed =
      image.first_byte + static_cast<std::uint64_t>(image.height - 1) * image.row_bytes + last_row;
  s.pds = PdsPixels{image.data_path, image.first_byte, image.row_bytes, needed, image.sample.little_endian};
  if (reading.damage == Damage::describe && data.bytes < needed)
    s.info.damage = "its data file " + image.data_path + (gone ? " is missing" : " was truncated");
  resolve_values(s, image.sphere_m, reading);
  set_post_grid(s.info, image.grid);
  return s;
}

// Records the file, with its state before it was opened, and, for a VRT, all files that it reads. Skips the caches that
// GDAL tools write next to them.
void note_files(RasterFile& s, const FileState& own) {
  char** files = s.dataset->GetFileList();
  for (int i = 0; files && files[i]; ++i) {
    const std::string file = files[i];
    if (file.ends_with(".aux.xml") || file.ends_with(".ovr")) continue;
    const auto state = file == s.info.path ? own : file_state(file);
    if (!state) continue;
    s.files.push_back({file, *state});
    s.info.bytes += state->bytes;
    s.info.modified_ns = std::max(s.info.modified_ns, state->modified_ns);
  }
  CSLDestroy(files);
}

// Returns the metres per unit of a band's samples: the band's own unit, else that of its dataset's vertical coordinate
// system.
double unit_in_metres(const BandValues& band, const std::string& path) {
  if (band.unit.empty()) return band.vertical_m.value_or(1);
  const std::optional<double> unit_m = metres_in(band.unit);
  if (!unit_m)
    throw NotHeights(
        path, fmt::format("its unit '{}' is none of those in which heights are read: {}", band.unit, kLengthUnits));
  constexpr double kRounding = 1e-9;
  if (band.vertical_m && std::abs(*band.vertical_m / *unit_m - 1) > kRounding)
    throw DataError(path,
                    fmt::format("its band is in '{}', its vertical coordinate system in units of {:.9g} m: declare "
                                "one unit, e.g. with gdal_edit.py -units",
                                band.unit, *band.vertical_m));
  return *unit_m;
}

// Throws DataError if a VRT leaves open what its samples mean. A VRT passes its sources' samples on without their unit,
// and without their scale if the VRT has its own.
void check_sources(const BandValues& own, const OpenDataset& open, const std::string& path) {
  const auto in_metres = [](const BandValues& v) {
    return v.unit.empty() ? v.vertical_m.value_or(1) == 1 : metres_in(v.unit) == 1;
  };
  // Accept a scale in the VRT for samples that have none.
  const auto same_scale = [&](const BandValues& v) {
    return (v.scale == 1 && v.offset == 0) || (v.scale == own.scale && v.offset == own.offset);
  };
  for (const auto& [file, bands] : open.sources) {
    // Every source has at least one band.
    const BandValues& first = bands.front();
    if (!own.declares_unit() && std::none_of(bands.begin(), bands.end(), in_metres))
      throw DataError(path, fmt::format("declares no unit, and its source {} is in {}: declare the unit of the VRT's "
                                        "heights, e.g. with gdal_edit.py -units {}",
                                        file, first.unit_name(), first.unit_name()));
    if (!open.rescales && std::none_of(bands.begin(), bands.end(), same_scale))
      throw DataError(path, fmt::format("has scale {} and offset {}, and its source {} has {} and {}: build it with "
                                        "gdalbuildvrt, or with gdal_translate -unscale",
                                        own.scale, own.offset, file, first.scale, first.offset));
  }
}

// Sets the band, its mask, the type of its samples, their scale to metres and their declared void.
void find_samples(RasterFile& s) {
  if (s.dataset->GetRasterCount() != 1)
    throw NotHeights(s.info.path,
                     "has " + std::to_string(s.dataset->GetRasterCount()) + " bands; a height map has one");
  s.band = s.dataset->GetRasterBand(1);
  s.type = s.band->GetRasterDataType();
  s.mask = mask_of(*s.band);
  if (s.type != GDT_Int16 && s.type != GDT_UInt16 && s.type != GDT_Int32 && s.type != GDT_UInt32 &&
      s.type != GDT_Float32 && s.type != GDT_Float64)
    throw NotHeights(s.info.path, std::string("samples of type ") + GDALGetDataTypeName(s.type) + " are not heights");
  const BandValues values = values_of(*s.dataset, 1);
  const double unit_m = unit_in_metres(values, s.info.path);
  s.scale = values.scale * unit_m;
  s.offset_m = values.offset * unit_m;
  int has_void = 0;
  const double void_value = s.band->GetNoDataValue(&has_void);
  if (has_void) s.voids.push_back(void_value);
}

// Reads kSamples evenly spread heights and their steps to the next row.
SparseHeights sparse_heights(RasterFile& raster) {
  SparseHeights found;
  const auto pick = [](int n, int k) { return static_cast<int>((2LL * k + 1) * n / (2 * kAcross)); };
  for (int row = 0; row < kAcross; ++row)
    for (int column = 0; column < kAcross; ++column) {
      double pair[2];
      const int y = std::min(pick(raster.file_height, row), raster.file_height - 2);
      read_samples(raster, pick(raster.file_width, column), y, 1, 2, pair);
      double height_m[2];
      bool is_valid[2];
      for (int i = 0; i < 2; ++i) {
        height_m[i] = pair[i] * raster.scale + raster.offset_m;
        is_valid[i] = !is_void(raster, pair[i]) && std::abs(height_m[i]) <= kFarthestHeight_m;
      }
      if (is_valid[0]) found.heights_m.push_back(height_m[0]);
      if (is_valid[0] && is_valid[1]) found.steps_m.push_back(height_m[1] - height_m[0]);
    }
  return found;
}

// Checks sparse heights. Skips the check if they cannot be read: a request for the damaged area fails later and names
// the file.
void check_sparse_values(RasterFile& raster) {
  SparseHeights sparse;
  try {
    sparse = sparse_heights(raster);
  } catch (const DataError&) {
    return;
  }
  check_values(raster.info, std::move(sparse));
}

// Describes a file that GDAL opens: a GeoTIFF, a VRT, or a remote file.
RasterFile describe_gdal(const std::string& path, const RasterReading& reading) {
  const FileState state = is_remote(path) ? FileState{} : must_exist(path, path);
  RasterFile s;
  // Open with these drivers only: other drivers' georeferencing of lunar products has not been examined.
  OpenDataset open = open_dataset(path, is_remote(path) ? kRemoteDrivers : kDemDrivers,
                                  reading.inspected ? CheckScope::again : CheckScope::first);
  s.dataset = std::move(open.dataset);
  s.info.on_network = open.remote;
  if (const std::size_t missing = open.missing.size(); missing == 1)
    s.info.gap = "its source " + *open.missing.begin() + " is missing";
  else if (missing > 1)
    s.info.gap = fmt::format("{} of its sources are missing, {} among them", missing, *open.missing.begin());
  const QuietGdal quiet;
  s.info.path = path;
  s.info.name = fs::path(path).stem().string();
  s.info.format = s.dataset->GetDriverName();
  s.info.width = s.file_width = s.dataset->GetRasterXSize();
  s.info.height = s.file_height = s.dataset->GetRasterYSize();
  if (is_remote(path)) {
    s.on_server = remote_state(path);
    s.info.bytes = s.on_server->bytes;
    s.info.modified_ns = s.on_server->modified_ns;
  } else {
    note_files(s, state);
  }
  const bool judged = !reading.inspected;
  GDALRasterBand* first = s.dataset->GetRasterCount() > 0 ? s.dataset->GetRasterBand(1) : nullptr;
  std::string_view quantity;
  if (judged) quantity = check_words(path, {{first ? first->GetDescription() : "", "its band's description"}}, {path});
  find_samples(s);
  const BandValues values = values_of(*s.dataset, 1);
  try {
    if (!reading.inspected) check_sources(values, open, path);
  } catch (const DataError& error) {
    if (reading.damage == Damage::refuse) throw;
    s.info.damage = error.what_is_wrong();
  }
  const Georeference georeference = georeference_of(*s.dataset, path);
  s.flip_x = georeference.flip_x;
  s.flip_y = georeference.flip_y;
  resolve_values(s, georeference.sphere_m, reading);
  set_post_grid(s.info, georeference.grid);
  const bool is_declared = values.declares_unit() || quantity == kHeights;
  if (judged && !is_declared && s.info.damage.empty() && s.info.gap.empty()) check_sparse_values(s);
  return s;
}

// Describes a file by its label if it has one, else by GDAL.
RasterFile describe(const std::string& path, const RasterReading& reading) {
  if (is_remote(path)) return describe_gdal(path, reading);
  must_exist(path, path);
  if (is_pds4_label(path)) throw DataError(path, kPds4Label);
  const std::optional<std::string> label = label_of(path);
  if (!label) return describe_gdal(path, reading);
  RasterFile file = describe_labelled_file(*label, reading);
  if (*label != path && !same_text(name_of(path), name_of(file.pds->data_path)))
    throw DataError(
        path, fmt::format("its label {} describes {}, another file", name_of(*label), name_of(file.pds->data_path)));
  return file;
}

// Hashes the stamps of all files and the conversion of samples to heights, which may come from another file (an
// .aux.xml).
std::uint64_t stamp_of(const RasterFile& s) {
  std::vector<std::uint64_t> facts{std::bit_cast<std::uint64_t>(s.scale), std::bit_cast<std::uint64_t>(s.offset_m)};
  for (const double none : s.voids) facts.push_back(std::bit_cast<std::uint64_t>(none));
  if (s.on_server) facts.push_back(stamp_of(*s.on_server));
  for (const FileSeen& file : s.files) facts.push_back(stamp_of(file.state));
  return hash_of(facts.data(), facts.size() * sizeof facts[0]);
}

}  // namespace

RasterFile describe_raster_file(const std::string& path, const RasterReading& reading) {
  RasterFile file = describe(path, reading);
  file.info.stamp = stamp_of(file);
  return file;
}

bool is_current(const RasterFile& s) {
  return std::all_of(s.files.begin(), s.files.end(),
                     [](const FileSeen& file) { return file_state(file.path) == file.state; });
}

// Uses GDAL's raw band with our own read-only file handle. A VRT over raw data would open the file for writing and
// share the handle with every other VRT of this thread.
void open_band(RasterFile& s) {
  if (s.band) return;
  errno = 0;
  VSILFILE* file = VSIFOpenL(s.pds->data_path.c_str(), "rb");
  if (!file && is_system_fault(errno)) throw SystemFault(s.pds->data_path, errno);
  if (!file) throw DataError(s.info.path, "its data file " + s.pds->data_path + " cannot be opened");
  const auto order =
      s.pds->little_endian ? RawRasterBand::ByteOrder::ORDER_LITTLE_ENDIAN : RawRasterBand::ByteOrder::ORDER_BIG_ENDIAN;
  s.raw = std::make_unique<RawRasterBand>(file, s.pds->first_byte, GDALGetDataTypeSizeBytes(s.type),
                                          static_cast<int>(s.pds->row_bytes), s.type, order, s.file_width,
                                          s.file_height, RawRasterBand::OwnFP::YES);
  s.band = s.raw.get();
  if (s.type == GDT_Int16) s.posts = std::make_unique<OpenFile>(s.pds->data_path, O_RDONLY);
}

namespace {

// Bytes per read. Rows of Kaguya's tiles are 8 to 24 KB: several per read keep the disk busy, and fit the core's
// nearest cache.
constexpr std::size_t kBytesAtOnce = std::size_t{1} << 17;

std::int16_t swapped(std::int16_t v) {
  const auto u = static_cast<std::uint16_t>(v);
  return static_cast<std::int16_t>(static_cast<std::uint16_t>((u >> 8) | (u << 8)));
}

// Converts samples to heights, in loops without branches, which the compiler vectorises.
void heights_of(const RasterFile& s, std::int16_t* samples, std::size_t n, float* out) {
  if (s.pds->little_endian != (std::endian::native == std::endian::little))
    for (std::size_t i = 0; i < n; ++i) samples[i] = swapped(samples[i]);
  constexpr float kNaN = std::numeric_limits<float>::quiet_NaN();
  if (s.scale == 1 && s.offset_m == 0) {
    for (std::size_t i = 0; i < n; ++i) out[i] = static_cast<float>(samples[i]);
  } else {
    for (std::size_t i = 0; i < n; ++i) {
      const double height_m = samples[i] * s.scale + s.offset_m;
      out[i] = std::abs(height_m) <= kFarthestHeight_m ? static_cast<float>(height_m) : kNaN;
    }
  }
  for (const double v : s.voids) {
    if (v != std::rint(v) || std::abs(v) > 32768) continue;  // no int16 sample has this value
    const auto none = static_cast<std::int16_t>(std::clamp(v, -32768.0, 32767.0));
    if (none != v) continue;
    for (std::size_t i = 0; i < n; ++i) out[i] = samples[i] == none ? kNaN : out[i];
  }
}

}  // namespace

// Reads samples directly from the file, as many rows at once as fit kBytesAtOnce.
void read_posts(const RasterFile& s, int x, int y, int w, int h, float* out, std::size_t stride) {
  check_still_there(s);
  const auto width = static_cast<std::size_t>(w);
  const std::uint64_t first =
      s.pds->first_byte + static_cast<std::uint64_t>(y) * s.pds->row_bytes + 2 * static_cast<std::uint64_t>(x);
  // Read several rows at once if there is no gap between them.
  const bool whole_rows = 2 * width == s.pds->row_bytes;
  const int rows_at_once =
      whole_rows ? static_cast<int>(std::clamp<std::size_t>(kBytesAtOnce / (2 * width), 1, static_cast<std::size_t>(h)))
                 : 1;
  std::vector<std::int16_t> samples(width * static_cast<std::size_t>(rows_at_once));
  for (int j = 0; j < h; j += rows_at_once) {
    const int rows = std::min(rows_at_once, h - j);
    bool is_complete = false;
    try {
      is_complete = s.posts->read(first + static_cast<std::uint64_t>(j) * s.pds->row_bytes,
                                  2 * width * static_cast<std::size_t>(rows), samples.data());
    } catch (const SystemFault& fault) {
      throw_file_error(s.info.path, fault.code());
    }
    if (!is_complete) throw DataError(s.info.path, "its data file " + s.pds->data_path + " was truncated");
    for (int r = 0; r < rows; ++r)
      heights_of(s, samples.data() + static_cast<std::size_t>(r) * width, width,
                 out + static_cast<std::size_t>(j + r) * stride);
  }
}

// Reads samples by GDAL, then sets those to NaN that the mask marks.
void read_samples(RasterFile& s, int x, int y, int w, int h, double* out) {
  check_still_there(s);
  const OpenOptions options(s.info.on_network);
  const QuietGdal quiet;
  const CPLErr error = s.band->RasterIO(GF_Read, x, y, w, h, out, w, h, GDT_Float64, 0, 0, nullptr);
  // Add the known gap: GDAL reports only once why a VRT's source cannot be opened.
  if (error != CE_None)
    quiet.fail(s.info.path, "cannot be read" + (s.info.gap.empty() ? std::string() : " (" + s.info.gap + ")"),
               s.info.on_network);
  if (!s.mask) return;
  std::vector<std::uint8_t> mask(static_cast<std::size_t>(w) * static_cast<std::size_t>(h));
  if (s.mask->RasterIO(GF_Read, x, y, w, h, mask.data(), w, h, GDT_Byte, 0, 0, nullptr) != CE_None)
    quiet.fail(s.info.path, "its mask cannot be read", s.info.on_network);
  for (std::size_t i = 0; i < mask.size(); ++i)
    if (mask[i] == 0) out[i] = std::numeric_limits<double>::quiet_NaN();
}

bool is_void(const RasterFile& s, double sample) {
  if (std::isnan(sample)) return true;
  for (const double v : s.voids) {
    if (sample == v) return true;
    // Compare as floats, too: a NoData such as -3.4028234663852886e+38, printed in decimal, means the nearest float.
    if (s.type == GDT_Float32 && static_cast<float>(sample) == static_cast<float>(v)) return true;
  }
  return false;
}

}  // namespace selenograph::dem
