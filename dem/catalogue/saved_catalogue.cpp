#include "dem/catalogue/saved_catalogue.h"

#include <fmt/format.h>

#include <cstring>
#include <filesystem>
#include <limits>
#include <mutex>
#include <set>
#include <stdexcept>
#include <type_traits>
#include <variant>

#include "dem/base/error.h"
#include "dem/base/hash.h"
#include "dem/files/files.h"
#include "dem/files/whole_file.h"
#include "dem/gdal/raster.h"

namespace selenograph::dem {
namespace {

namespace fs = std::filesystem;

constexpr char kMagic[8] = {'S', 'G', 'C', 'A', 'T', 'A', 'L', 'G'};
// Version of the file format. Increment it when the same files give other findings, or findings other bytes.
constexpr std::uint32_t kFormatVersion = 10;

struct Header {
  char magic[8];
  std::uint32_t version;
  std::uint32_t unused;
  std::uint64_t bytes;     // number of bytes after the header
  std::uint64_t checksum;  // XXH3 of these bytes
};

// Returns the versions of the programs on which the interpretation of a file depends.
std::string readers() { return std::string(SELENOGRAPH_VERSION) + ", GDAL " + gdal_version(); }

// Writes numbers as they are in memory, and texts with their lengths. The byte order is this machine's, as is the cache
// folder.
class Writer {
 public:
  template <typename T>
  requires std::is_arithmetic_v<T>
  void put(T value) { bytes_.append(reinterpret_cast<const char*>(&value), sizeof value); }
  void put(const std::string& text) {
    put(static_cast<std::uint64_t>(text.size()));
    bytes_ += text;
  }
  template <typename T>
  void put(const std::optional<T>& value) {
    put(value.has_value());
    if (value) put(*value);
  }
  void put(const GeographicGrid& grid) { each_member(grid, *this); }
  void put(MapProjection projection) { put(static_cast<std::uint8_t>(projection)); }
  void put(const MapPlane& plane) { each_member(plane, *this); }
  void put(const PlaneGrid& grid) { each_member(grid, *this); }
  void put(const PostGrid& grid) {
    put(static_cast<std::uint8_t>(grid.index()));
    std::visit([&](const auto& g) { put(g); }, grid);
  }
  void put(const Footprint& f) { each_member(f, *this); }
  void put(const RasterInfo& info) { each_member(info, *this); }

  template <typename... Members>
  void operator()(const Members&... members) {
    (put(members), ...);
  }
  const std::string& bytes() const { return bytes_; }

  // Visits all members of a struct. The bindings must name every member, so that a new one does not compile until it is
  // added here.
  template <typename Info, typename Visit>
  static void each_member(Info& info, Visit& visit) {
    using T = std::remove_const_t<Info>;
    if constexpr (std::is_same_v<T, GeographicGrid>) {
      auto& [lat, lon, lat_ppd, lon_ppd] = info;
      visit(lat, lon, lat_ppd, lon_ppd);
    } else if constexpr (std::is_same_v<T, MapPlane>) {
      auto& [projection, lat, lon, parallel, scale] = info;
      visit(projection, lat, lon, parallel, scale);
    } else if constexpr (std::is_same_v<T, PlaneGrid>) {
      auto& [plane, x, y, spacing] = info;
      visit(plane, x, y, spacing);
    } else if constexpr (std::is_same_v<T, Footprint>) {
      auto& [south, north, west, east] = info;
      visit(south, north, west, east);
    } else {
      auto& [path, name, format, width, height, grid, ppd, spacing, footprint, wraps, level, datum, quantisation,
             void_value, bytes, modified, stamp, on_network, damage, gap, synthetic] = info;
      visit(path, name, format, width, height, grid, ppd, spacing, footprint, wraps, level, datum, quantisation,
            void_value, bytes, modified, stamp, on_network, damage, gap, synthetic);
    }
  }

 private:
  std::string bytes_;
};

// Reads such bytes. Checks every length, although the checksum is right.
class Reader {
 public:
  explicit Reader(std::string_view bytes) : left_(bytes) {}

  bool done() const { return left_.empty(); }
  template <typename T>
  requires std::is_arithmetic_v<T>
  void get(T& value) {
    // Read a bool as a byte: another value than 0 and 1 in a bool is undefined behaviour.
    std::conditional_t<std::is_same_v<T, bool>, std::uint8_t, T> raw;
    std::memcpy(&raw, take(sizeof raw).data(), sizeof raw);
    value = static_cast<T>(raw);
  }
  void get(std::string& text) {
    std::uint64_t size = 0;
    get(size);
    text = take(size);
  }
  template <typename T>
  void get(std::optional<T>& value) {
    bool has_value = false;
    get(has_value);
    if (has_value) get(value.emplace());
  }
  void get(GeographicGrid& grid) { Writer::each_member(grid, *this); }
  void get(MapProjection& projection) {
    std::uint8_t number = 0;
    get(number);
    projection = static_cast<MapProjection>(number);
  }
  void get(MapPlane& plane) { Writer::each_member(plane, *this); }
  void get(PlaneGrid& grid) { Writer::each_member(grid, *this); }
  void get(PostGrid& grid) {
    std::uint8_t index = 0;
    get(index);
    if (index == 0)
      get(grid.emplace<0>());
    else
      get(grid.emplace<1>());
  }
  void get(Footprint& f) { Writer::each_member(f, *this); }
  void get(RasterInfo& info) { Writer::each_member(info, *this); }

  template <typename... Members>
  void operator()(Members&... members) {
    (get(members), ...);
  }

 private:
  std::string_view take(std::uint64_t size) {
    if (size > left_.size()) throw std::out_of_range("ends too early");
    const std::string_view bytes = left_.substr(0, size);
    left_.remove_prefix(size);
    return bytes;
  }
  std::string_view left_;
};

// Returns the content of a saved catalogue's file: header, key and readers, then each file's result.
std::string encode(const std::string& key, const std::vector<const SavedFile*>& files) {
  Writer out;
  out(key, readers());
  for (const SavedFile* file : files) {
    out(file->path, file->stamp, static_cast<std::uint64_t>(file->others.size()));
    for (const auto& [path, stamp] : file->others) out(path, stamp);
    out(file->raster);
  }
  Header header{{}, kFormatVersion, 0, out.bytes().size(), hash_of(out.bytes().data(), out.bytes().size())};
  std::memcpy(header.magic, kMagic, sizeof kMagic);
  return std::string(reinterpret_cast<const char*>(&header), sizeof header) + out.bytes();
}

// Decodes the bytes of a file into `files`. Returns the reason why they cannot be used; empty if they can.
std::string decode(std::string_view bytes, const std::string& key, std::vector<SavedFile>& files) {
  Header header;
  if (bytes.size() < sizeof header) return "is truncated";
  std::memcpy(&header, bytes.data(), sizeof header);
  bytes.remove_prefix(sizeof header);
  if (std::memcmp(header.magic, kMagic, sizeof kMagic) != 0) return "is damaged";
  if (header.version != kFormatVersion) return "was written by another version";
  if (header.bytes != bytes.size()) return "is truncated";
  if (header.checksum != hash_of(bytes.data(), bytes.size())) return "is damaged: its checksum is wrong";
  Reader in(bytes);
  std::string its_key, its_readers;
  in(its_key, its_readers);
  if (its_readers != readers()) return "was written by another version";
  if (its_key != key) return "is about other files";
  while (!in.done()) {
    SavedFile& file = files.emplace_back();
    std::uint64_t others = 0;
    in(file.path, file.stamp, others);
    for (; others > 0; --others) {
      auto& [path, stamp] = file.others.emplace_back();
      in(path, stamp);
    }
    in(file.raster);
  }
  return {};
}

// Returns the text that identifies a list of paths. It has absolute paths, too: relative ones mean other files in
// another working directory.
std::string key_of(const std::vector<std::string>& paths) {
  std::string key;
  for (const std::string& path : paths) {
    std::error_code ignored;
    key += fs::absolute(path, ignored).string() + '\0' + path + '\0';
  }
  return key;
}

// Removes temporary files of ended processes, once per folder. Files that bear the number of a living process stay.
void remove_stale_temporaries_once(const std::string& folder) {
  static std::mutex mutex;
  static std::set<std::string> done;
  const std::lock_guard lock(mutex);
  if (done.insert(folder).second) remove_stale_temporaries(folder, ".sgc.tmp-");
}

}  // namespace

void SavedCatalogue::read(const std::string& cache_dir, const std::vector<std::string>& paths, Log log) {
  log_ = std::move(log);
  if (cache_dir.empty()) return;
  key_ = key_of(paths);
  path_ = fmt::format("{}/catalogue/{:016x}.sgc", cache_dir, hash_of(key_.data(), key_.size()));
  std::string wrong;
  try {
    std::error_code error;
    if (!fs::exists(path_, error) && !error) return;
    wrong = decode(read_head(path_, std::numeric_limits<std::size_t>::max()), key_, files_);
  } catch (const std::runtime_error& fault) {  // DataError or SystemFault: opening goes on without the saved catalogue
    wrong = fault.what();
  } catch (const std::out_of_range& fault) {
    wrong = fault.what();
  }
  if (!wrong.empty()) {
    files_.clear();
    if (log_) log_(fmt::format("saved catalogue {}: {}; the DEM files are read again", path_, wrong));
  }
  by_path_.reserve(files_.size());
  for (SavedFile& file : files_) by_path_.emplace(file.path, &file);
}

SavedFile* SavedCatalogue::find(std::string_view path) {
  const auto found = by_path_.find(path);
  return found == by_path_.end() ? nullptr : found->second;
}

void SavedCatalogue::replace(const std::vector<const SavedFile*>& files) {
  if (path_.empty()) return;
  try {
    remove_stale_temporaries_once(fs::path(path_).parent_path().string());
    write_whole_file(path_, encode(key_, files));
  } catch (const SystemFault& fault) {
    if (log_) log_(fmt::format("{}; the DEM files will be read again at the next start", fault.what()));
  }
}

}  // namespace selenograph::dem
