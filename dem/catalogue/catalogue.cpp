#include "dem/catalogue/catalogue.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <filesystem>
#include <numeric>
#include <tuple>

#include "dem/base/hash.h"
#include "dem/base/names.h"
#include "dem/grid/grid_shift.h"

namespace selenograph::dem {
namespace {

constexpr int kRows = 180, kColumns = 360;  // cells of the bucket grid, of 1 degree
constexpr double kTouch_deg = 1e-9;         // tolerance of 0.03 mm: borders touch despite rounding

// Returns an angle in [0, 360).
double wrap_360(double deg) {
  const double w = std::fmod(deg, 360.0);
  return w < 0 ? w + 360 : w;
}

// Returns true if two arcs [west, east] share a longitude: one begins inside the other. East may exceed 180 degrees.
bool arcs_overlap(double west_a, double east_a, double west_b, double east_b) {
  return wrap_360(west_b - west_a + kTouch_deg) <= east_a - west_a + 2 * kTouch_deg ||
         wrap_360(west_a - west_b + kTouch_deg) <= east_b - west_b + 2 * kTouch_deg;
}

// Cells of the bucket grid that a box touches. Columns wrap around the globe.
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

// Latitudes and longitudes, degrees.
struct Box {
  double south, north, west, east;
};

// Returns the boxes that a box grown by `margin` covers. A box that reaches over a pole becomes two: beyond the pole it
// covers other longitudes, so the second has all of them.
std::vector<Box> grown_boxes(double south, double north, double west, double east, double margin) {
  std::vector<Box> boxes = {
      {std::max(south - margin, -90.0), std::min(north + margin, 90.0), west - margin, east + margin}};
  if (east - west + 2 * margin >= 360) {
    boxes[0].west = -180;
    boxes[0].east = 180;
  }
  if (north + margin > 90) boxes.push_back({180 - north - margin, 90, -180, 180});
  if (south - margin < -90) boxes.push_back({-90, -180 - south + margin, -180, 180});
  return boxes;
}

bool touches(const Footprint& f, const Box& b) {
  return f.south_deg <= b.north + kTouch_deg && f.north_deg >= b.south - kTouch_deg &&
         arcs_overlap(f.west_deg, f.east_deg, b.west, b.east);
}

constexpr double kSameSpacing = 1.01;  // ratio of post spacings within one layer: labels round the spacing

// Hashes everything about the files that a frame depends on.
std::uint64_t fingerprint_of(const std::vector<RasterInfo>& rasters) {
  // Hash names without folders: the same tiles give the same frames wherever they are mounted.
  std::uint64_t hash = xxh64_of(nullptr, 0, rasters.size());
  for (const RasterInfo& r : rasters) {
    hash = xxh64_of(r.name.data(), r.name.size(), hash);
    const Footprint& f = r.footprint;
    const std::uint64_t facts[] = {r.stamp,
                                   static_cast<std::uint64_t>(r.width),
                                   static_cast<std::uint64_t>(r.height),
                                   std::bit_cast<std::uint64_t>(f.south_deg),
                                   std::bit_cast<std::uint64_t>(f.north_deg),
                                   std::bit_cast<std::uint64_t>(f.west_deg),
                                   std::bit_cast<std::uint64_t>(f.east_deg)};
    hash = xxh64_of(facts, sizeof facts, hash);
  }
  return hash;
}

}  // namespace

Catalogue::Catalogue(const std::vector<std::string>& paths) {
  FoundFiles found = find_files(paths);
  rasters_ = std::move(found.rasters);
  problems_ = std::move(found.problems);
  side_layers_ = std::move(found.side_layers);
  index(paths);
}

Catalogue::Catalogue(std::vector<RasterInfo> rasters) : rasters_(std::move(rasters)) { index({}); }

namespace {

// Returns the index of the first path that names a file: the file itself, a file with its stem (data or label), or a
// folder above it; the number of paths if none does.
std::size_t naming_path(const RasterInfo& raster, const std::vector<std::string>& paths) {
  const auto without_extension = [](std::string_view path) {
    const std::string_view name = name_of(path);
    return path.substr(0, path.size() - name.size() + stem_of(name).size());
  };
  const std::string_view file = raster.path;
  const auto is_named_by = [&](std::string_view path) {
    const bool is_folder_above =
        file.starts_with(path) && file.size() > path.size() && (path.ends_with('/') || file[path.size()] == '/');
    return is_folder_above || without_extension(file) == without_extension(path);
  };
  return static_cast<std::size_t>(std::find_if(paths.begin(), paths.end(), is_named_by) - paths.begin());
}

// Returns true if a raster has the resolution of the coarsest one of a run, within kSameSpacing.
bool has_spacing_of(const RasterInfo& coarsest, const RasterInfo& raster) {
  return &coarsest == &raster || coarsest.post_spacing_m < kSameSpacing * raster.post_spacing_m;
}

// Moves the rasters that were named first to the end of each run of equal resolution, where they take precedence.
void order_by_names(std::vector<RasterInfo*>& order, const std::vector<std::string>& paths) {
  if (paths.size() < 2) return;
  for (auto first = order.begin(); first != order.end();) {
    const auto past =
        std::find_if_not(first, order.end(), [&](const RasterInfo* r) { return has_spacing_of(**first, *r); });
    std::stable_sort(first, past, [&](const RasterInfo* a, const RasterInfo* b) {
      return naming_path(*a, paths) > naming_path(*b, paths);
    });
    first = past;
  }
}

}  // namespace

// Divides the rasters, which are sorted from coarse to fine, into layers: sets the first file of each file's layer.
void Catalogue::find_layers(const std::vector<std::string>& paths) {
  // Rasters are one layer if one path names them, or if their posts are on one grid, as those of a product's tiles are
  // even if the user names each tile.
  const auto are_one_layer = [&](const RasterInfo& a, const RasterInfo& b) {
    return paths.size() < 2 || naming_path(a, paths) == naming_path(b, paths) || shift_between(a.grid, b.grid);
  };
  layer_begin_.clear();
  const RasterInfo* coarsest = nullptr;  // of the run of equal resolution so far, whose order is by naming path
  for (const RasterInfo& raster : rasters_) {
    const int index = static_cast<int>(layer_begin_.size());  // of this raster
    const int layer = layer_begin_.empty() ? 0 : layer_begin_.back();
    const RasterInfo& first = rasters_[static_cast<std::size_t>(layer)];
    const bool same_run = coarsest && has_spacing_of(*coarsest, raster);
    if (!same_run || raster.post_spacing_m > coarsest->post_spacing_m) coarsest = &raster;
    layer_begin_.push_back(same_run && are_one_layer(first, raster) ? layer : index);
  }
}

// Sorts the rasters from coarse to fine, finds their layers, and fills the lookups by path and by cell.
void Catalogue::index(const std::vector<std::string>& paths) {
  // Sort pointers: exchanging the descriptions themselves would take longer than everything else here.
  std::vector<RasterInfo*> order;
  order.reserve(rasters_.size());
  for (RasterInfo& raster : rasters_) order.push_back(&raster);
  std::sort(order.begin(), order.end(), [](const RasterInfo* a, const RasterInfo* b) {
    return std::tie(b->post_spacing_m, a->name, a->path) < std::tie(a->post_spacing_m, b->name, b->path);
  });
  order_by_names(order, paths);
  std::vector<RasterInfo> sorted;
  sorted.reserve(rasters_.size());
  for (RasterInfo* raster : order) sorted.push_back(std::move(*raster));
  rasters_ = std::move(sorted);
  find_layers(paths);
  by_path_.resize(rasters_.size());
  std::iota(by_path_.begin(), by_path_.end(), SourceIndex{0});
  std::sort(by_path_.begin(), by_path_.end(), [&](SourceIndex a, SourceIndex b) {
    return std::tie(rasters_[a].path, a) < std::tie(rasters_[b].path, b);
  });
  buckets_.assign(static_cast<std::size_t>(kRows) * kColumns, {});
  for (std::size_t i = 0; i < rasters_.size(); ++i) {
    const Footprint& f = rasters_[i].footprint;
    for_each_cell(cells_of(f.south_deg, f.north_deg, f.west_deg, f.east_deg),
                  [&](std::size_t cell) { buckets_[cell].push_back(static_cast<int>(i)); });
  }
  find_fingerprint();
}

void Catalogue::join_layers(LayerJoins joins) {
  joins_ = std::move(joins);
  if (std::all_of(joins_.offsets_m.begin(), joins_.offsets_m.end(), [](double m) { return m == 0; }))
    joins_.offsets_m.clear();
  if (std::all_of(joins_.resolved_posts.begin(), joins_.resolved_posts.end(), [](double n) { return n == 1; }))
    joins_.resolved_posts.clear();
  find_fingerprint();
}

void Catalogue::find_fingerprint() {
  fingerprint_ = fingerprint_of(rasters_);
  for (const std::vector<double>* numbers : {&joins_.offsets_m, &joins_.resolved_posts})
    if (!numbers->empty()) fingerprint_ = xxh64_of(numbers->data(), numbers->size() * sizeof(double), fingerprint_);
  if (!one_layer()) fingerprint_ = xxh64_of(&joins_.blend_posts, sizeof joins_.blend_posts, fingerprint_);
}

std::optional<SourceIndex> Catalogue::find(const std::string& path) const {
  const auto found = std::lower_bound(by_path_.begin(), by_path_.end(), path,
                                      [&](SourceIndex i, const std::string& p) { return rasters_[i].path < p; });
  if (found == by_path_.end() || rasters_[*found].path != path) return std::nullopt;
  return *found;
}

// Looks up the cells of the bucket grid that the grown box touches, then tests the footprints in them.
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

std::vector<std::string> warnings_about(const Catalogue& catalogue, std::span<const SourceIndex> replaced) {
  const auto name = [](const std::string& path) { return std::filesystem::path(path).filename().string(); };
  std::vector<std::string> texts;
  for (const CatalogueProblem& problem : catalogue.problems())
    if (!problem.located && !problem.unrelated)
      texts.push_back(name(problem.path) + ": cannot be used; where it lies is unknown");
  for (const SourceIndex i : replaced)
    texts.push_back(name(catalogue.rasters()[i].path) + ": cannot be used; the layer below stands in for it");
  return texts;
}

}  // namespace selenograph::dem
