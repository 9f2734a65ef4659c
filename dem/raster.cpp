#include "dem/raster.h"

#include <ogr_spatialref.h>
#include <rawdataset.h>

#include <algorithm>
#include <bit>
#include <cctype>
#include <cmath>
#include <filesystem>
#include <limits>
#include <mutex>
#include <shared_mutex>
#include <unordered_map>

#include "dem/error.h"
#include "dem/gdal_manners.h"
#include "dem/geodesy.h"
#include "dem/pds_label.h"

namespace selenograph::dem {
namespace {

namespace fs = std::filesystem;

constexpr double kNoRadiusBelow_m = 1.6e6;  // heights are within 11 km of zero, radii within 11 km of 1737.4 km
constexpr const char* kHeightDatum = "sphere 1737.4 km, height";
constexpr const char* kRadiusDatum = "planetary radius, converted";

// ---- GDAL's manners ------------------------------------------------------------------------------------------------

// While opening, for this thread: no listing of the folder per file (64 800 tiles), and no source datasets shared
// between two VRTs opened by one thread, since those may later be read by different threads.
class OpenOptions {
 public:
  OpenOptions() { set("TRUE", "FALSE"); }
  ~OpenOptions() { set(nullptr, nullptr); }
  OpenOptions(const OpenOptions&) = delete;
  OpenOptions& operator=(const OpenOptions&) = delete;

 private:
  static void set(const char* no_listing, const char* share) {
    CPLSetThreadLocalConfigOption("GDAL_DISABLE_READDIR_ON_OPEN", no_listing);
    CPLSetThreadLocalConfigOption("VRT_SHARED_SOURCE", share);
  }
};

// ---- files ---------------------------------------------------------------------------------------------------------

FileState must_exist(const std::string& path, const std::string& named) {
  if (const auto state = file_state(path)) return *state;
  throw DataError(named, path == named ? "is missing or not a file" : "its file " + path + " is missing");
}

std::string lower_extension(const fs::path& path) {
  std::string e = path.extension().string();
  std::transform(e.begin(), e.end(), e.begin(), [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
  return e;
}

// The label, when `path` is a PDS3 product: itself, or the sibling of a bare .img. Nothing for other files.
std::optional<std::string> pds_label_of(const std::string& path) {
  const std::string extension = lower_extension(path);
  if (extension == ".lbl" || begins_with_pds_label(path)) return path;
  if (extension != ".img") return std::nullopt;
  for (const char* e : {".lbl", ".LBL", ".Lbl"}) {
    const std::string label = fs::path(path).replace_extension(e).string();
    if (file_state(label)) return label;
  }
  return std::nullopt;
}

// ---- what is known about an open file
// --------------------------------------------------------------------------------

struct PdsPixels {
  std::string data_path;
  std::uint64_t first_byte = 0, row_bytes = 0, bytes_needed = 0;
  bool little_endian = false;
};

struct Source {
  RasterInfo info;
  PostGrid grid;
  GDALDataType type = GDT_Unknown;
  // height_m = sample * scale + offset
  double scale = 1, offset_m = 0;
  std::vector<double> voids;
  bool flip_x = false, flip_y = false;  // stored east to west, south to north
  int file_width = 0, file_height = 0;
  std::optional<PdsPixels> pds;
  DatasetPtr dataset;                  // of everything that isn't PDS3
  std::unique_ptr<RawRasterBand> raw;  // of PDS3, once open
  GDALRasterBand* band = nullptr;
};

bool is_integer(GDALDataType type) { return GDALDataTypeIsInteger(type) != 0; }

GDALDataType gdal_type(const PdsSample& s) {
  if (s.real) return s.bytes == 4 ? GDT_Float32 : GDT_Float64;
  if (s.bytes == 2) return s.has_sign ? GDT_Int16 : GDT_UInt16;
  return s.has_sign ? GDT_Int32 : GDT_UInt32;
}

// GDAL's own raw band with a file handle of ours, read-only: a VRT over raw data would open the file for writing and
// share the handle with every other VRT of this thread.
void open_raw_band(Source& s) {
  VSILFILE* file = VSIFOpenL(s.pds->data_path.c_str(), "rb");
  if (!file) throw DataError(s.info.path, "its data file " + s.pds->data_path + " can't be opened");
  const auto order =
      s.pds->little_endian ? RawRasterBand::ByteOrder::ORDER_LITTLE_ENDIAN : RawRasterBand::ByteOrder::ORDER_BIG_ENDIAN;
  s.raw = std::make_unique<RawRasterBand>(file, s.pds->first_byte, GDALGetDataTypeSizeBytes(s.type),
                                          static_cast<int>(s.pds->row_bytes), s.type, order, s.file_width,
                                          s.file_height, RawRasterBand::OwnFP::YES);
  s.band = s.raw.get();
}

// GDAL fills what is missing at the end of a raw file with zeros; we never do.
void check_still_there(const Source& s) {
  if (!s.pds) return;
  const auto state = file_state(s.pds->data_path);
  if (!state || state->bytes < s.pds->bytes_needed)
    throw DataError(s.info.path, "its data file " + s.pds->data_path + (state ? " was truncated" : " vanished"));
}

// File pixels (x, y, w, h) as double, row-major.
void read_samples(Source& s, int x, int y, int w, int h, double* out) {
  const QuietGdal quiet;
  check_still_there(s);
  const CPLErr error = s.band->RasterIO(GF_Read, x, y, w, h, out, w, h, GDT_Float64, 0, 0, nullptr);
  if (error != CE_None) throw DataError(s.info.path, "can't be read: " + quiet.complaint());
}

bool is_void(const Source& s, double sample) {
  if (std::isnan(sample)) return true;
  for (const double v : s.voids) {
    if (sample == v) return true;
    // A NoData such as -3.4028234663852886e+38 is printed in decimal: it means the nearest float.
    if (s.type == GDT_Float32 && static_cast<float>(sample) == static_cast<float>(v)) return true;
  }
  return false;
}

// Whether the samples are radii: by the offset, else (where the type can hold a radius at all) by the median of a few.
bool holds_radii(Source& s) {
  if (s.offset_m > kNoRadiusBelow_m) return true;
  const bool narrow = is_integer(s.type) && GDALGetDataTypeSizeBytes(s.type) <= 2;
  if (narrow && std::abs(s.scale) * 65535 + s.offset_m < kNoRadiusBelow_m) return false;
  if (!s.band) open_raw_band(s);
  constexpr int kAcross = 6;
  std::vector<double> heights;
  for (int i = 0; i < kAcross * kAcross; ++i) {
    const auto pick = [](int n, int k) { return static_cast<int>((2LL * k + 1) * n / (2 * kAcross)); };
    double sample = 0;
    read_samples(s, pick(s.file_width, i % kAcross), pick(s.file_height, i / kAcross), 1, 1, &sample);
    if (!is_void(s, sample)) heights.push_back(sample * s.scale + s.offset_m);
  }
  if (heights.empty()) return false;
  const auto middle = heights.begin() + static_cast<std::ptrdiff_t>(heights.size() / 2);
  std::nth_element(heights.begin(), middle, heights.end());
  return *middle > kNoRadiusBelow_m;
}

// `known`: what an earlier inspection found, so that opening needs no second look at the samples.
void settle_values(Source& s, const RasterInfo* known) {
  if (!std::isfinite(s.scale) || !std::isfinite(s.offset_m))
    throw DataError(s.info.path, "its scale or offset is beyond the range of double");
  const bool radii = known ? known->datum == kRadiusDatum : holds_radii(s);
  if (radii) s.offset_m -= kMoonRadius_m;
  s.info.datum = radii ? kRadiusDatum : kHeightDatum;
  s.info.quantisation_m = is_integer(s.type) ? std::abs(s.scale) : 0;
  if (!s.voids.empty()) s.info.void_value = s.voids.front();
}

// ---- geographic grids
// ------------------------------------------------------------------------------------------------

// Width of the columns that differ; a product that repeats its first meridian (0 and 360) loses the copy.
void settle_columns(RasterInfo& info, GeographicGrid& g) {
  constexpr double kRounding = 0.05;  // of a post; pixel sizes in metres are printed rounded
  const double circle = 360 * g.lon_posts_per_degree;
  if (info.width < circle - kRounding) return;
  if (std::abs(circle - std::round(circle)) > kRounding) {
    if (info.width - 1 <= circle) return;
    throw DataError(info.path, "covers more than 360 degrees of longitude");
  }
  info.width = static_cast<int>(std::lround(circle));
  info.wraps_longitude = true;
  g.lon_posts_per_degree = info.width / 360.0;
}

// n of the 2^-n degree lattice that all posts lie on exactly, if there is one.
std::optional<int> lattice_of(const GeographicGrid& g, int posts_along) {
  constexpr double kTolerance = 1e-9;  // of a post
  const double ppd = std::round(g.lat_posts_per_degree);
  if (ppd < 1 || ppd > 1 << 24 || !std::has_single_bit(static_cast<std::uint32_t>(ppd))) return std::nullopt;
  // A resolution that is a little wrong adds up along the raster.
  for (const double p : {g.lat_posts_per_degree, g.lon_posts_per_degree})
    if (std::abs(p / ppd - 1) * posts_along > kTolerance) return std::nullopt;
  for (const double first : {g.first_lat_deg, g.first_lon_deg})
    if (std::abs(first * ppd - std::round(first * ppd)) > kTolerance) return std::nullopt;
  return std::countr_zero(static_cast<std::uint32_t>(ppd));
}

void settle_geographic(Source& s, GeographicGrid g) {
  RasterInfo& info = s.info;
  settle_columns(info, g);
  info.lattice_level = lattice_of(g, std::max(info.width, info.height));
  if (info.lattice_level) {
    const double ppd = std::ldexp(1.0, *info.lattice_level);
    g = {std::round(g.first_lat_deg * ppd) / ppd, std::round(g.first_lon_deg * ppd) / ppd, ppd, ppd};
  }
  const double south = g.first_lat_deg - (info.height - 1) / g.lat_posts_per_degree;
  const double slack = 0.05 / g.lat_posts_per_degree;
  if (!(g.first_lat_deg <= 90 + slack && south >= -90 - slack)) throw DataError(info.path, "has rows beyond a pole");
  g.first_lon_deg = wrap_lon_deg(g.first_lon_deg);
  const double across = info.wraps_longitude ? 360 : (info.width - 1) / g.lon_posts_per_degree;
  info.projection = Projection::geographic;
  info.posts_per_degree = g.lat_posts_per_degree;
  info.post_spacing_m = kMetresPerDegree / g.lat_posts_per_degree;
  // A row within the slack beyond a pole lies on it.
  const auto on_sphere = [](double lat_deg) { return std::clamp(lat_deg, -90.0, 90.0); };
  info.footprint = {on_sphere(south), on_sphere(g.first_lat_deg), g.first_lon_deg, g.first_lon_deg + across};
  s.grid = g;
}

// RasterInfo has no grid of its own: of a geographic raster the footprint and the size say it all.
GeographicGrid grid_of(const RasterInfo& info) {
  const Footprint& f = info.footprint;
  const double columns = info.wraps_longitude ? info.width : info.width - 1;
  const double across = f.east_deg - f.west_deg;
  double ppd = columns > 0 && across > 0 ? columns / across : info.posts_per_degree;
  // The division may lose the last bit; on square grids (all but oddities) it needn't.
  if (std::abs(ppd / info.posts_per_degree - 1) < 1e-12) ppd = info.posts_per_degree;
  return {f.north_deg, f.west_deg, info.posts_per_degree, ppd};
}

Raster::PostXY locate_on(const GeographicGrid& g, const RasterInfo& info, double lat_deg, double lon_deg) {
  Raster::PostXY p{0, (g.first_lat_deg - lat_deg) * g.lat_posts_per_degree};
  if (info.wraps_longitude) {
    const double turns = std::floor((lon_deg - g.first_lon_deg) / 360);
    p.x = (lon_deg - g.first_lon_deg - 360 * turns) * g.lon_posts_per_degree;
    if (p.x >= info.width) p.x -= info.width;
    p.x = std::max(p.x, 0.0);
  } else {
    const double middle = (info.footprint.west_deg + info.footprint.east_deg) / 2;
    const double turns = std::round((lon_deg - middle) / 360);
    p.x = (lon_deg - 360 * turns - g.first_lon_deg) * g.lon_posts_per_degree;
  }
  return p;
}

// ---- polar grids
// -----------------------------------------------------------------------------------------------------

// Forward, Snyder (1987) 21-5, 21-6, 21-9, 21-10 on the sphere.
Raster::PostXY locate_on(const PolarGrid& g, double lat_deg, double lon_deg) {
  const double colatitude = (90 - (g.north ? lat_deg : -lat_deg)) * kRadiansPerDegree;
  const double rho_m = 2 * kMoonRadius_m * g.scale * std::tan(colatitude / 2);
  const double turn = (lon_deg - g.central_lon_deg) * kRadiansPerDegree;
  const double x_m = rho_m * std::sin(turn);
  const double y_m = (g.north ? -1 : 1) * rho_m * std::cos(turn);
  return {(x_m - g.first_x_m) / g.spacing_m, (g.first_y_m - y_m) / g.spacing_m};
}

// Inverse, Snyder (1987) 21-15 and 20-16 on the sphere.
Geographic place_on(const PolarGrid& g, double x_m, double y_m) {
  const double colatitude = 2 * std::atan(std::hypot(x_m, y_m) / (2 * kMoonRadius_m * g.scale)) / kRadiansPerDegree;
  const double turn = std::atan2(x_m, g.north ? -y_m : y_m) / kRadiansPerDegree;
  return {g.north ? 90 - colatitude : colatitude - 90, wrap_lon_deg(g.central_lon_deg + turn), 0};
}

// Where the longitudes of a rectangle that leaves the pole out begin and end: at corners, since it is convex.
void longitudes_of(const PolarGrid& g, double east_m, double south_m, Footprint& f) {
  const double middle = place_on(g, (g.first_x_m + east_m) / 2, (g.first_y_m + south_m) / 2).lon_deg;
  double low = 0, high = 0;
  for (const double x : {g.first_x_m, east_m})
    for (const double y : {g.first_y_m, south_m}) {
      const double away = std::remainder(place_on(g, x, y).lon_deg - middle, 360);
      low = std::min(low, away);
      high = std::max(high, away);
    }
  f.west_deg = wrap_lon_deg(middle + low);
  f.east_deg = f.west_deg + (high - low);
}

Footprint footprint_of(const PolarGrid& g, int width, int height) {
  const double east_m = g.first_x_m + (width - 1) * g.spacing_m;
  const double south_m = g.first_y_m - (height - 1) * g.spacing_m;
  const double far_x = std::max(std::abs(g.first_x_m), std::abs(east_m));
  const double far_y = std::max(std::abs(g.first_y_m), std::abs(south_m));
  const double near_x = std::clamp(0.0, g.first_x_m, east_m), near_y = std::clamp(0.0, south_m, g.first_y_m);
  const double far_lat = place_on(g, far_x, far_y).lat_deg, near_lat = place_on(g, near_x, near_y).lat_deg;
  Footprint f{std::min(far_lat, near_lat), std::max(far_lat, near_lat), -180, 180};
  if (near_x != 0 || near_y != 0) longitudes_of(g, east_m, south_m, f);
  return f;
}

// locate() without an open file needs the grid of a polar raster, which RasterInfo can't carry: kept from inspection.
class PolarGrids {
 public:
  void put(const std::string& path, const PolarGrid& g) {
    const std::unique_lock lock(mutex_);
    grids_[path] = g;
  }
  std::optional<PolarGrid> get(const std::string& path) const {
    const std::shared_lock lock(mutex_);
    const auto found = grids_.find(path);
    return found == grids_.end() ? std::nullopt : std::optional(found->second);
  }
  static PolarGrids& all() {
    static PolarGrids grids;
    return grids;
  }

 private:
  mutable std::shared_mutex mutex_;
  std::unordered_map<std::string, PolarGrid> grids_;
};

void settle_polar(Source& s, const PolarGrid& g) {
  s.info.projection = Projection::polar_stereographic;
  s.info.posts_per_degree = kMetresPerDegree * g.scale / g.spacing_m;
  s.info.post_spacing_m = g.spacing_m / g.scale;
  s.info.footprint = footprint_of(g, s.info.width, s.info.height);
  s.grid = g;
  PolarGrids::all().put(s.info.path, g);
}

void settle_grid(Source& s, const PostGrid& grid) {
  if (const auto* g = std::get_if<GeographicGrid>(&grid)) settle_geographic(s, *g);
  if (const auto* g = std::get_if<PolarGrid>(&grid)) settle_polar(s, *g);
}

// ---- PDS3
// ------------------------------------------------------------------------------------------------------------

enum class Damage { refuse, describe };

Source describe_pds(const std::string& label_path, const RasterInfo* known, Damage damage) {
  const PdsImage image = describe_pds_image(read_pds_label(label_path), label_path);
  if (image.row_bytes > std::numeric_limits<int>::max()) throw DataError(label_path, "its rows are too long");
  const FileState label = must_exist(label_path, label_path);
  const bool gone = damage == Damage::describe && !file_state(image.data_path);
  const FileState data = gone ? FileState{} : must_exist(image.data_path, label_path);

  Source s;
  s.info.path = label_path;
  s.info.name = fs::path(label_path).stem().string();
  s.info.format = image.format;
  s.info.width = s.file_width = image.width;
  s.info.height = s.file_height = image.height;
  s.info.bytes = data.bytes;
  s.info.modified_ns = std::max(label.modified_ns, data.modified_ns);
  s.type = gdal_type(image.sample);
  s.scale = image.scale * image.unit_m;
  s.offset_m = image.offset * image.unit_m;
  s.voids = image.voids;
  const std::uint64_t last_row =
      static_cast<std::uint64_t>(image.width) * static_cast<std::uint64_t>(image.sample.bytes);
  const std::uint64_t needed =
      image.first_byte + static_cast<std::uint64_t>(image.height - 1) * image.row_bytes + last_row;
  s.pds = PdsPixels{image.data_path, image.first_byte, image.row_bytes, needed, image.sample.little_endian};
  if (damage == Damage::describe && data.bytes < needed)
    s.info.damage = "its data file " + image.data_path + (gone ? " is missing" : " was truncated");
  RasterInfo heights;  // can't be told from damaged data, and won't be needed
  heights.datum = kHeightDatum;
  settle_values(s, s.info.damage.empty() ? known : &heights);
  settle_grid(s, image.grid);
  return s;
}

// ---- GeoTIFF, COG, VRT
// -----------------------------------------------------------------------------------------------

DatasetPtr open_dataset(const std::string& path) {
  register_gdal();
  const QuietGdal quiet;
  const OpenOptions options;
  // Other drivers are left out: their georeferencing of lunar products has not been judged.
  const char* const drivers[] = {"GTiff", "VRT", nullptr};
  DatasetPtr dataset(static_cast<GDALDataset*>(
      GDALOpenEx(path.c_str(), GDAL_OF_RASTER | GDAL_OF_READONLY | GDAL_OF_VERBOSE_ERROR, drivers, nullptr, nullptr)));
  if (!dataset) throw DataError(path, "can't be opened: " + quiet.complaint());
  return dataset;
}

// The file and, for a VRT, everything that it reads; not the caches that GDAL tools leave beside it.
void note_files(RasterInfo& info, GDALDataset& dataset) {
  char** files = dataset.GetFileList();
  for (int i = 0; files && files[i]; ++i) {
    const std::string file = files[i];
    if (file.ends_with(".aux.xml") || file.ends_with(".ovr")) continue;
    const auto state = file_state(file);
    if (!state) continue;
    info.bytes += state->bytes;
    info.modified_ns = std::max(info.modified_ns, state->modified_ns);
  }
  CSLDestroy(files);
}

void check_sphere(const OGRSpatialReference& srs, const std::string& path) {
  const double a = srs.GetSemiMajor(), b = srs.GetSemiMinor();
  if (std::abs(a - kMoonRadius_m) > 0.5 || std::abs(b - kMoonRadius_m) > 0.5)
    throw DataError(path, "its ellipsoid of " + std::to_string(a) + " x " + std::to_string(b) +
                              " m is not the Moon's sphere of 1737400 m");
}

// First post and (positive) spacing in the units of the coordinate system. Rasters stored the other way round are
// flipped.
struct Plane {
  double first_x = 0, first_y = 0, dx = 0, dy = 0;
};

Plane find_plane(Source& s) {
  double t[6];
  if (s.dataset->GetGeoTransform(t) != CE_None) throw DataError(s.info.path, "has no geotransform");
  if (t[2] != 0 || t[4] != 0) throw DataError(s.info.path, "is rotated or sheared; warp it to north-up first");
  if (!(std::isfinite(t[0]) && std::isfinite(t[3]) && std::abs(t[1]) > 0 && std::abs(t[5]) > 0))
    throw DataError(s.info.path, "has an impossible geotransform");
  s.flip_x = t[1] < 0;
  s.flip_y = t[5] > 0;
  // GDAL's transform is of pixel corners whatever AREA_OR_POINT says (it moves PixelIsPoint files itself): posts are
  // the centres.
  const double column = s.flip_x ? s.file_width - 0.5 : 0.5, row = s.flip_y ? s.file_height - 0.5 : 0.5;
  return {t[0] + column * t[1], t[3] + row * t[5], std::abs(t[1]), std::abs(t[5])};
}

GeographicGrid grid_in_degrees(const Plane& p, double lon0_deg) {
  return {p.first_y, p.first_x + lon0_deg, 1 / p.dy, 1 / p.dx};
}

// Pixel sizes and origins in metres are degrees that somebody multiplied and rounded. Where whole posts per degree and
// half posts of position are that near, they were meant: without this no file in metres would wrap or meet its
// neighbour.
void undo_rounding(GeographicGrid& g) {
  for (double* ppd : {&g.lat_posts_per_degree, &g.lon_posts_per_degree})
    if (std::abs(*ppd / std::round(*ppd) - 1) < 2e-7) *ppd = std::round(*ppd);
  const auto to_half_post = [](double& deg, double ppd) {
    const double nearest = std::round(deg * ppd * 2) / 2;
    if (std::abs(deg * ppd - nearest) < 0.02) deg = nearest / ppd;
  };
  to_half_post(g.first_lat_deg, g.lat_posts_per_degree);
  to_half_post(g.first_lon_deg, g.lon_posts_per_degree);
}

GeographicGrid grid_in_metres(const OGRSpatialReference& srs, const Plane& p) {
  const double unit_m = srs.GetLinearUnits();
  const double shrink = std::cos(srs.GetNormProjParm(SRS_PP_STANDARD_PARALLEL_1, 0) * kRadiansPerDegree);
  const double lat0 = srs.GetNormProjParm(SRS_PP_LATITUDE_OF_ORIGIN, 0);
  const double lon0 = srs.GetNormProjParm(SRS_PP_CENTRAL_MERIDIAN, 0);
  const double x_m = (p.first_x - srs.GetProjParm(SRS_PP_FALSE_EASTING, 0)) * unit_m;
  const double y_m = (p.first_y - srs.GetProjParm(SRS_PP_FALSE_NORTHING, 0)) * unit_m;
  GeographicGrid g{lat0 + y_m / kMetresPerDegree, lon0 + x_m / (kMetresPerDegree * shrink),
                   kMetresPerDegree / (p.dy * unit_m), kMetresPerDegree * shrink / (p.dx * unit_m)};
  undo_rounding(g);
  return g;
}

PolarGrid grid_on_pole(const OGRSpatialReference& srs, const Plane& p, const std::string& path) {
  if (std::abs(p.dx / p.dy - 1) > 1e-9) throw DataError(path, "a polar raster must have square pixels");
  const double unit_m = srs.GetLinearUnits();
  const double lat = srs.GetNormProjParm(SRS_PP_LATITUDE_OF_ORIGIN, 90);
  PolarGrid g;
  g.north = lat > 0;
  // A latitude of true scale short of the pole: k0 = (1 + sin lat) / 2 on the sphere (Snyder 1987, 21-7).
  g.scale = srs.GetNormProjParm(SRS_PP_SCALE_FACTOR, 1) * (1 + std::sin(std::abs(lat) * kRadiansPerDegree)) / 2;
  g.central_lon_deg = srs.GetNormProjParm(SRS_PP_CENTRAL_MERIDIAN, 0);
  g.first_x_m = (p.first_x - srs.GetProjParm(SRS_PP_FALSE_EASTING, 0)) * unit_m;
  g.first_y_m = (p.first_y - srs.GetProjParm(SRS_PP_FALSE_NORTHING, 0)) * unit_m;
  g.spacing_m = p.dx * unit_m;
  return g;
}

PostGrid find_grid(Source& s) {
  const OGRSpatialReference* srs = s.dataset->GetSpatialRef();
  if (!srs) throw DataError(s.info.path, "has no coordinate system");
  check_sphere(*srs, s.info.path);
  const Plane plane = find_plane(s);
  const double prime_deg = srs->GetPrimeMeridian();
  if (srs->IsGeographic()) {
    if (std::abs(srs->GetAngularUnits() / kRadiansPerDegree - 1) > 1e-9)
      throw DataError(s.info.path, "is not in degrees");
    return grid_in_degrees(plane, prime_deg);
  }
  if (prime_deg != 0) throw DataError(s.info.path, "a projected raster with its own prime meridian is not supported");
  const char* name = srs->GetAttrValue("PROJECTION");
  const std::string projection = name ? name : "none";
  if (EQUAL(projection.c_str(), SRS_PT_EQUIRECTANGULAR)) return grid_in_metres(*srs, plane);
  const bool at_pole = std::abs(std::abs(srs->GetNormProjParm(SRS_PP_LATITUDE_OF_ORIGIN, 0)) - 90) < 1e-9;
  if (EQUAL(projection.c_str(), SRS_PT_POLAR_STEREOGRAPHIC) ||
      (EQUAL(projection.c_str(), SRS_PT_STEREOGRAPHIC) && at_pole))
    return grid_on_pole(*srs, plane, s.info.path);
  throw DataError(s.info.path, "its projection '" + projection + "' is not supported; warp it to degrees first");
}

double unit_in_metres(const std::string& unit, const std::string& path) {
  const auto is = [&](const char* name) { return EQUAL(unit.c_str(), name); };
  if (unit.empty() || is("m") || is("metre") || is("metres") || is("meter") || is("meters")) return 1;
  if (is("km") || is("kilometre") || is("kilometres") || is("kilometer") || is("kilometers")) return 1000;
  throw DataError(path, "its unit '" + unit + "' is no height");
}

void find_values(Source& s, const RasterInfo* known) {
  if (s.dataset->GetRasterCount() != 1)
    throw DataError(s.info.path, "has " + std::to_string(s.dataset->GetRasterCount()) + " bands; a height map has one");
  s.band = s.dataset->GetRasterBand(1);
  s.type = s.band->GetRasterDataType();
  if (s.type != GDT_Int16 && s.type != GDT_UInt16 && s.type != GDT_Int32 && s.type != GDT_UInt32 &&
      s.type != GDT_Float32 && s.type != GDT_Float64)
    throw DataError(s.info.path, std::string("samples of type ") + GDALGetDataTypeName(s.type) + " are not heights");
  const double unit_m = unit_in_metres(s.band->GetUnitType(), s.info.path);
  s.scale = s.band->GetScale() * unit_m;
  s.offset_m = s.band->GetOffset() * unit_m;
  if (s.scale == 0) throw DataError(s.info.path, "its scale is zero");
  int has_void = 0;
  const double void_value = s.band->GetNoDataValue(&has_void);
  if (has_void) s.voids.push_back(void_value);
  settle_values(s, known);
}

Source describe_gdal(const std::string& path, const RasterInfo* known) {
  must_exist(path, path);
  Source s;
  s.dataset = open_dataset(path);
  const QuietGdal quiet;
  s.info.path = path;
  s.info.name = fs::path(path).stem().string();
  s.info.format = s.dataset->GetDriverName();
  s.info.width = s.file_width = s.dataset->GetRasterXSize();
  s.info.height = s.file_height = s.dataset->GetRasterYSize();
  note_files(s.info, *s.dataset);
  find_values(s, known);
  settle_grid(s, find_grid(s));
  return s;
}

Source describe(const std::string& path, const RasterInfo* known, Damage damage = Damage::refuse) {
  must_exist(path, path);
  if (const auto label = pds_label_of(path)) return describe_pds(*label, known, damage);
  return describe_gdal(path, known);
}

PolarGrid polar_grid_of(const RasterInfo& info) {
  const auto known = PolarGrids::all().get(info.path);
  return known ? *known : std::get<PolarGrid>(describe(info.path, &info).grid);
}

}  // namespace

// ---- public
// ----------------------------------------------------------------------------------------------------------

RasterInfo inspect_raster(const std::string& path) { return describe(path, nullptr).info; }

RasterInfo inspect_damaged_raster(const std::string& path) { return describe(path, nullptr, Damage::describe).info; }

Raster::PostXY locate(const RasterInfo& info, double lat_deg, double lon_deg) {
  if (info.projection == Projection::geographic) return locate_on(grid_of(info), info, lat_deg, lon_deg);
  return locate_on(polar_grid_of(info), lat_deg, lon_deg);
}

Geographic place_of_post(const RasterInfo& info, int x, int y) {
  if (info.projection == Projection::geographic) {
    const GeographicGrid g = grid_of(info);
    return {g.first_lat_deg - y / g.lat_posts_per_degree, wrap_lon_deg(g.first_lon_deg + x / g.lon_posts_per_degree),
            0};
  }
  const PolarGrid grid = polar_grid_of(info);
  return place_on(grid, grid.first_x_m + x * grid.spacing_m, grid.first_y_m - y * grid.spacing_m);
}

struct Raster::Impl {
  explicit Impl(Source s) : source(std::move(s)) {
    if (const auto* g = std::get_if<GeographicGrid>(&source.grid)) find_mirrors(*g);
  }

  // On a global raster row r beyond a pole is row mirror - r on the opposite meridian. Not so when the poles lie
  // elsewhere than on a row or half-way between two, or when no column is opposite.
  void find_mirrors(const GeographicGrid& g) {
    const RasterInfo& info = source.info;
    if (!info.wraps_longitude || info.width % 2 != 0) return;
    const auto whole = [](double x) -> std::optional<std::int64_t> {
      return std::abs(x - std::round(x)) < 1e-6 ? std::optional<std::int64_t>(std::llround(x)) : std::nullopt;
    };
    north_mirror = whole(2 * (g.first_lat_deg - 90) * g.lat_posts_per_degree);
    south_mirror = whole(2 * (g.first_lat_deg + 90) * g.lat_posts_per_degree);
  }

  struct Row {
    std::int64_t row = -1;  // -1: outside
    bool opposite = false;

    bool operator==(const Row&) const = default;
  };
  Row row_at(std::int64_t y) const {
    const std::int64_t height = source.info.height;
    if (y >= 0 && y < height) return {y, false};
    const auto& mirror = y < 0 ? north_mirror : south_mirror;
    if (!mirror) return {};
    const std::int64_t row = *mirror - y;
    return row >= 0 && row < height ? Row{row, true} : Row{};
  }

  // Posts that all lie in the file. `stride` counts floats from one row of `out` to the next.
  void read_inside(int x, int y, int w, int h, float* out, std::size_t stride) {
    Source& s = source;
    scratch.resize(static_cast<std::size_t>(w) * static_cast<std::size_t>(h));
    read_samples(s, s.flip_x ? s.file_width - x - w : x, s.flip_y ? s.file_height - y - h : y, w, h, scratch.data());
    const double* sample = scratch.data();
    for (int j = 0; j < h; ++j)
      for (int i = 0; i < w; ++i, ++sample) {
        const auto row = static_cast<std::size_t>(s.flip_y ? h - 1 - j : j);
        const auto column = static_cast<std::size_t>(s.flip_x ? w - 1 - i : i);
        const double height_m = *sample * s.scale + s.offset_m;
        if (!is_void(s, *sample) && std::abs(height_m) <= kFarthestHeight_m)
          out[row * stride + column] = static_cast<float>(height_m);
      }
  }

  // Any columns of rows that lie in the file.
  void read_rows(std::int64_t x0, int y, int w, int h, float* out) {
    const std::int64_t width = source.info.width;
    const auto stride = static_cast<std::size_t>(w);
    if (!source.info.wraps_longitude) {
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

  Source source;
  std::optional<std::int64_t> north_mirror, south_mirror;
  std::vector<double> scratch;
};

Raster::Raster(const RasterInfo& info) {
  if (!info.damage.empty()) throw DataError(info.path, info.damage);
  Source s = describe(info.path, &info);
  const RasterInfo& now = s.info;
  if (now.bytes != info.bytes || now.modified_ns != info.modified_ns || now.width != info.width ||
      now.height != info.height)
    throw DataError(info.path, "has changed since it was catalogued");
  if (!s.band) open_raw_band(s);
  impl_ = std::make_unique<Impl>(std::move(s));
}

Raster::~Raster() = default;
Raster::Raster(Raster&&) noexcept = default;
Raster& Raster::operator=(Raster&&) noexcept = default;

const RasterInfo& Raster::info() const { return impl_->source.info; }

Raster::PostXY Raster::locate(double lat_deg, double lon_deg) const {
  const Source& s = impl_->source;
  if (const auto* g = std::get_if<PolarGrid>(&s.grid)) return locate_on(*g, lat_deg, lon_deg);
  return locate_on(std::get<GeographicGrid>(s.grid), s.info, lat_deg, lon_deg);
}

void Raster::read(int x0, int y0, int w, int h, float* heights_m) {
  if (w <= 0 || h <= 0) return;
  const auto width = static_cast<std::size_t>(w);
  std::fill_n(heights_m, width * static_cast<std::size_t>(h), std::numeric_limits<float>::quiet_NaN());
  for (int j = 0; j < h;) {
    const Impl::Row row = impl_->row_at(static_cast<std::int64_t>(y0) + j);
    int count = 1;
    // Rows that follow each other in the file are read together; mirrored ones run backwards, one at a time.
    while (!row.opposite && row.row >= 0 && j + count < h &&
           impl_->row_at(static_cast<std::int64_t>(y0) + j + count) == Impl::Row{row.row + count, false})
      ++count;
    if (row.row >= 0) {
      const std::int64_t turn = row.opposite ? impl_->source.info.width / 2 : 0;
      impl_->read_rows(x0 + turn, static_cast<int>(row.row), w, count, heights_m + static_cast<std::size_t>(j) * width);
    }
    j += count;
  }
}

}  // namespace selenograph::dem
