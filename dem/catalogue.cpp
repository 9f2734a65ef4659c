#include "dem/catalogue.h"

#include <algorithm>
#include <bit>
#include <cctype>
#include <cmath>
#include <filesystem>
#include <numeric>
#include <tuple>
#include <unordered_set>

#define XXH_INLINE_ALL
#include <xxhash.h>

#include "dem/error.h"
#include "dem/files.h"
#include "dem/gdal/raster.h"
#include "dem/pds_label.h"

namespace selenograph::dem {
namespace {

namespace fs = std::filesystem;

constexpr int kRows = 180, kColumns = 360;
constexpr double kTouch_deg = 1e-9;  // 0.03 mm: borders that touch do so despite rounding

std::string lower(std::string s) {
  std::transform(s.begin(), s.end(), s.begin(), [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
  return s;
}

// The files that inspection may find usable; `labelled` are the stems (in lower case) of the .lbl files of their
// folder.
bool is_candidate(const fs::path& file, const std::unordered_set<std::string>& labelled) {
  switch (kind_of(file)) {
    case FileKind::pds_label:
    case FileKind::georeferenced:
      return true;
    case FileKind::pds_image:
      return !labelled.contains(lower((file.parent_path() / file.stem()).string())) &&
             begins_with_pds_label(file.string());
    case FileKind::other:
      return false;
  }
  return false;
}

// A label about something else than a map (a scene before projection, a table) is nobody's mistake in a folder.
bool is_other_product(const std::string& path) {
  const FileKind kind = kind_of(path);
  return (kind == FileKind::pds_label || kind == FileKind::pds_image) && !describes_map(read_pds_label(path));
}

// Whether a label beside it has an image's name, or names it.
bool is_labelled(const fs::path& image, const std::unordered_set<std::string>& labelled,
                 const std::vector<fs::path>& files) {
  if (labelled.contains(lower((image.parent_path() / image.stem()).string()))) return true;
  const std::string name = lower(image.filename().string());
  return std::any_of(files.begin(), files.end(), [&](const fs::path& file) {
    if (kind_of(file) != FileKind::pds_label || file.parent_path() != image.parent_path()) return false;
    try {
      const PdsObject label = read_pds_label(file.string());
      return std::any_of(label.values.begin(), label.values.end(),
                         [&](const auto& v) { return v.first.starts_with('^') && lower(v.second.text()) == name; });
    } catch (const DataError&) {
      return false;
    }
  });
}

std::vector<std::string> files_below(const std::string& folder, std::vector<CatalogueProblem>& problems) {
  std::vector<fs::path> files;
  std::unordered_set<std::string> labelled;
  std::error_code error;
  auto entry = fs::recursive_directory_iterator(folder, fs::directory_options::skip_permission_denied, error);
  for (; !error && entry != fs::recursive_directory_iterator(); entry.increment(error)) {
    std::error_code not_a_file;
    if (!entry->is_regular_file(not_a_file)) continue;
    const fs::path& file = entry->path();
    if (kind_of(file) == FileKind::pds_label) labelled.insert(lower((file.parent_path() / file.stem()).string()));
    files.push_back(file);
  }
  if (is_system_fault(error.value())) throw SystemFault(folder, error.value());
  if (error) problems.push_back({folder, "can't be searched: " + error.message(), false, false});
  std::vector<std::string> candidates;
  std::sort(files.begin(), files.end());  // folders list in any order
  for (const fs::path& file : files) {
    if (is_candidate(file, labelled))
      candidates.push_back(file.string());
    else if (kind_of(file) == FileKind::pds_image && !is_labelled(file, labelled, files))
      problems.push_back({file.string(), "its label is missing: what it holds, and where, is unknown", false, true});
  }
  return candidates;
}

double wrap_360(double deg) {
  const double w = std::fmod(deg, 360.0);
  return w < 0 ? w + 360 : w;
}

// Whether the arcs [west, east] share a longitude.
bool longitudes_meet(double west_a, double east_a, double west_b, double east_b) {
  return wrap_360(west_b - west_a + kTouch_deg) <= east_a - west_a + 2 * kTouch_deg ||
         wrap_360(west_a - west_b + kTouch_deg) <= east_b - west_b + 2 * kTouch_deg;
}

// A box of latitudes and longitudes in the bucket grid.
struct Cells {
  int first_row, last_row, first_column, columns;
};

Cells cells_of(double south, double north, double west, double east) {
  const auto row = [](double lat) { return std::clamp(static_cast<int>(std::floor(lat + 90)), 0, kRows - 1); };
  Cells c{row(south - kTouch_deg), row(north + kTouch_deg), 0, kColumns};
  const double from = std::floor(west - kTouch_deg), to = std::floor(east + kTouch_deg);
  if (to - from + 1 >= kColumns) return c;
  c.first_column = static_cast<int>(wrap_360(from + 180));
  c.columns = static_cast<int>(to - from) + 1;
  return c;
}

template <typename Visit>
void for_each_cell(const Cells& c, Visit&& visit) {
  for (int row = c.first_row; row <= c.last_row; ++row)
    for (int k = 0; k < c.columns; ++k)
      visit(static_cast<std::size_t>(row) * kColumns + static_cast<std::size_t>((c.first_column + k) % kColumns));
}

struct Box {
  double south, north, west, east;
};

// Several, where the box reaches over a pole: what lies beyond it is on other longitudes.
std::vector<Box> grown_boxes(double south, double north, double west, double east, double margin) {
  std::vector<Box> boxes = {
      {std::max(south - margin, -90.0), std::min(north + margin, 90.0), west - margin, east + margin}};
  if (east - west + 2 * margin >= 360) boxes[0].west = -180, boxes[0].east = 180;
  if (north + margin > 90) boxes.push_back({180 - north - margin, 90, -180, 180});
  if (south - margin < -90) boxes.push_back({-90, -180 - south + margin, -180, 180});
  return boxes;
}

bool touches(const Footprint& f, const Box& b) {
  return f.south_deg <= b.north + kTouch_deg && f.north_deg >= b.south - kTouch_deg &&
         longitudes_meet(f.west_deg, f.east_deg, b.west, b.east);
}

}  // namespace

Catalogue::Catalogue(const std::vector<std::string>& paths) {
  std::unordered_set<std::string> seen;  // a file may be given twice, or with its folder
  const auto add = [&](const RasterInfo& info) {
    if (seen.insert(fs::weakly_canonical(info.path).string()).second) rasters_.push_back(info);
  };
  for (const std::string& path : paths) {
    std::error_code error;
    if (!fs::is_directory(path, error)) {
      add(inspect_raster(path));
      continue;
    }
    for (const std::string& file : files_below(path, problems_)) {
      try {
        if (!is_other_product(file)) add(inspect_raster(file));
      } catch (const DataError& e) {
        // Another file's fault (a VRT's source) is told with its name.
        problems_.push_back({file, e.file() == file ? e.what_is_wrong() : e.what(), false, false});
        try {
          add(inspect_damaged_raster(file));
          problems_.back().located = true;
        } catch (const DataError&) {
          // Not even its place is known: the problem says so.
        }
      }
    }
  }
  index();
}

Catalogue::Catalogue(std::vector<RasterInfo> rasters) : rasters_(std::move(rasters)) { index(); }

void Catalogue::index() {
  std::sort(rasters_.begin(), rasters_.end(), [](const RasterInfo& a, const RasterInfo& b) {
    return std::tie(b.post_spacing_m, a.name, a.path) < std::tie(a.post_spacing_m, b.name, b.path);
  });
  by_path_.resize(rasters_.size());
  std::iota(by_path_.begin(), by_path_.end(), SourceIndex{0});
  std::stable_sort(by_path_.begin(), by_path_.end(),
                   [&](SourceIndex a, SourceIndex b) { return rasters_[a].path < rasters_[b].path; });
  buckets_.assign(static_cast<std::size_t>(kRows) * kColumns, {});
  for (std::size_t i = 0; i < rasters_.size(); ++i) {
    const Footprint& f = rasters_[i].footprint;
    for_each_cell(cells_of(f.south_deg, f.north_deg, f.west_deg, f.east_deg),
                  [&](std::size_t cell) { buckets_[cell].push_back(static_cast<int>(i)); });
  }
}

std::optional<SourceIndex> Catalogue::find(const std::string& path) const {
  const auto found = std::lower_bound(by_path_.begin(), by_path_.end(), path,
                                      [&](SourceIndex i, const std::string& p) { return rasters_[i].path < p; });
  if (found == by_path_.end() || rasters_[*found].path != path) return std::nullopt;
  return *found;
}

std::vector<int> Catalogue::touching(double south_deg, double north_deg, double west_deg, double east_deg,
                                     double margin_deg) const {
  std::vector<int> found;
  for (const Box& box : grown_boxes(south_deg, north_deg, west_deg, east_deg, margin_deg))
    for_each_cell(cells_of(box.south, box.north, box.west, box.east), [&](std::size_t cell) {
      for (const int i : buckets_[cell])
        if (touches(rasters_[static_cast<std::size_t>(i)].footprint, box)) found.push_back(i);
    });
  std::sort(found.begin(), found.end());
  found.erase(std::unique(found.begin(), found.end()), found.end());
  return found;
}

std::uint64_t Catalogue::fingerprint() const {
  // Names and not folders: the same tiles give the same frames wherever they are mounted.
  std::uint64_t hash = XXH64(nullptr, 0, rasters_.size());
  for (const RasterInfo& r : rasters_) {
    hash = XXH64(r.name.data(), r.name.size(), hash);
    const Footprint& f = r.footprint;
    const std::uint64_t facts[] = {r.bytes,
                                   static_cast<std::uint64_t>(r.modified_ns),
                                   static_cast<std::uint64_t>(r.width),
                                   static_cast<std::uint64_t>(r.height),
                                   std::bit_cast<std::uint64_t>(f.south_deg),
                                   std::bit_cast<std::uint64_t>(f.north_deg),
                                   std::bit_cast<std::uint64_t>(f.west_deg),
                                   std::bit_cast<std::uint64_t>(f.east_deg)};
    hash = XXH64(facts, sizeof facts, hash);
  }
  return hash;
}

}  // namespace selenograph::dem
