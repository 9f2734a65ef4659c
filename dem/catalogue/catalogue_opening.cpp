#include "dem/catalogue/catalogue_opening.h"

#include <fmt/format.h>

#include <algorithm>
#include <exception>
#include <filesystem>
#include <functional>
#include <list>
#include <map>
#include <memory>
#include <string_view>
#include <system_error>
#include <unordered_map>
#include <unordered_set>
#include <utility>

#include "dem/base/error.h"
#include "dem/base/names.h"
#include "dem/base/parallel.h"
#include "dem/files/files.h"
#include "dem/files/folder_files.h"
#include "dem/files/labels.h"
#include "dem/files/quantity.h"
#include "dem/gdal/raster.h"
#include "dem/gdal/remote_names.h"

namespace selenograph::dem {
namespace {

namespace fs = std::filesystem;

// File to inspect.
struct Candidate {
  std::string path;
  const FolderFiles* folder = nullptr;  // folder that lists the file; null for a remote file
  const FolderEntry* entry = nullptr;   // entry of the folder; null if it does not list the file
  bool named = false;                   // the user named the file itself, not a folder above: it must be usable
};

// Result of inspecting a candidate.
struct Finding {
  std::optional<RasterInfo> raster;
  std::optional<CatalogueProblem> problem;
  std::optional<SideLayer> side_layer;
  std::string data;           // file that holds the samples, if its name is not the label's
  bool unlabelled = false;    // an image whose label is missing, unless another's label names it
  std::exception_ptr thrown;  // rethrown by collect()
};

// Orders candidates as std::filesystem::path does, component by component: '/' sorts before all other characters.
bool path_less(const Candidate& a, const Candidate& b) {
  if (a.folder == b.folder) return a.path < b.path;
  const auto rank = [](char c) { return c == '/' ? 0 : static_cast<unsigned char>(c); };
  return std::lexicographical_compare(a.path.begin(), a.path.end(), b.path.begin(), b.path.end(),
                                      [&](char x, char y) { return rank(x) < rank(y); });
}

// Returns true if a file is a label with an image's name.
bool is_label_of(const FolderEntry& entry, std::string_view image) {
  return kind_of(entry.name) == FileKind::label && same_text(stem_of(entry.name), stem_of(image));
}

// Returns true if a file is a PDS4 label of a raster that only the label describes; a GeoTIFF describes itself.
bool is_lone_pds4_label(const FolderFiles& folder, const FolderEntry& entry) {
  if (!same_text(entry.name.substr(stem_of(entry.name).size()), ".xml")) return false;
  const auto group = folder.group_of(entry);
  const auto describes_itself = [](const FolderEntry& e) { return kind_of(e.name) == FileKind::georeferenced; };
  return std::none_of(group.begin(), group.end(), describes_itself) && is_pds4_label(folder.path_of(entry.name));
}

// Lists folders. A folder of files that the user names is listed once only.
class Folders {
 public:
  const FolderFiles& list(const std::string& folder) {
    const FolderFiles*& listed = listed_[folder];
    if (!listed) listed = listings_.emplace_back(std::make_unique<FolderFiles>(folder)).get();
    return *listed;
  }

  // Returns the candidates below a folder, in the order of their paths.
  std::vector<Candidate> candidates_below(const std::string& folder, std::vector<CatalogueProblem>& problems) {
    std::vector<Candidate> found;
    std::vector<std::string> folders{folder};
    int trouble = 0;
    while (!folders.empty()) {
      const std::string listed_folder = std::move(folders.back());
      folders.pop_back();
      const FolderFiles& files = *listings_.emplace_back(std::make_unique<FolderFiles>(listed_folder, &folders));
      if (files.trouble() != 0 && files.trouble() != EACCES) trouble = files.trouble();
      for (const FolderEntry& entry : files.entries()) {
        const FileKind kind = kind_of(entry.name);
        if (kind == FileKind::other) {
          if (is_lone_pds4_label(files, entry))
            problems.push_back({files.path_of(entry.name), kPds4Label, false, true});
          continue;
        }
        if (kind == FileKind::labelled_image) {
          const auto group = files.group_of(entry);
          if (std::any_of(group.begin(), group.end(), [&](const auto& e) { return is_label_of(e, entry.name); }))
            continue;
        }
        found.push_back({files.path_of(entry.name), &files, &entry, false});
      }
    }
    if (trouble != 0)
      problems.push_back({folder, "cannot be searched: " + std::generic_category().message(trouble), false, false});
    // Skip the sort if possible: names of one product in one folder are listed in this order already.
    if (!std::is_sorted(found.begin(), found.end(), path_less)) std::sort(found.begin(), found.end(), path_less);
    return found;
  }

 private:
  std::vector<std::unique_ptr<FolderFiles>> listings_;  // all listings: candidates point at them
  std::map<std::string, const FolderFiles*> listed_;    // folders of files that the user names
};

// One opening of a catalogue: lists the files, inspects them, and gathers the findings in the order of the user's
// paths.
class Opening {
 public:
  explicit Opening(const std::vector<std::string>& paths) : paths_(paths) {}

  FoundFiles run() {
    list();
    inspect_all();
    FoundFiles found;
    for (const NamedPath& path : named_paths_) collect(path, found);
    return found;
  }

 private:
  // Candidates of one of the user's paths.
  struct NamedPath {
    std::size_t first, past_last;  // range of candidates_
    std::vector<CatalogueProblem> problems;
  };

  // Finds the candidates of all paths.
  void list() {
    for (const std::string& path : paths_) {
      NamedPath named{candidates_.size(), 0, {}};
      std::error_code error;
      if (is_remote(path)) {
        candidates_.push_back({path, nullptr, nullptr, true});
      } else if (fs::is_directory(path, error)) {
        std::vector<Candidate> below = folders_.candidates_below(path, named.problems);
        std::move(below.begin(), below.end(), std::back_inserter(candidates_));
      } else {
        const FolderFiles& folder = folders_.list(fs::path(path).parent_path().string());
        candidates_.push_back({path, &folder, folder.find(name_of(path)), true});
      }
      named.past_last = candidates_.size();
      named_paths_.push_back(std::move(named));
    }
    findings_.resize(candidates_.size());
  }

  // Inspects all candidates in parallel. Keeps each exception for collect(), which rethrows the first in order of
  // candidates: the error does not depend on thread timing.
  void inspect_all() {
    in_parallel_pieces(candidates_.size(), 64, [&](std::size_t first, std::size_t past_last) {
      for (std::size_t i = first; i < past_last; ++i) try {
          findings_[i] = inspect(candidates_[i]);
        } catch (...) {
          findings_[i].thrown = std::current_exception();
        }
    });
  }

  // Inspects a file. Throws for an unusable file only if the user named it.
  Finding inspect(const Candidate& file) {
    Finding out;
    if (!file.named && kind_of(file.path) == FileKind::labelled_image && !begins_with_label(file.path)) {
      out.unlabelled = true;
      return out;
    }
    std::vector<std::string> read;
    try {
      out.raster = inspect_raster(file.path, &read);
      if (!out.raster->gap.empty()) out.problem = {file.path, out.raster->gap, true, false};
      note_data(file, read, out);
    } catch (const SideRaster& e) {
      if (file.named) throw;
      out.side_layer = {file.path, e.quantity()};
    } catch (const NotHeights& e) {
      if (file.named) throw;
      out.problem = {file.path, e.what_is_wrong(), false, true};
    } catch (const DataError& e) {
      if (file.named) throw;
      if (!describes_other_product(file.path)) describe_problem(file.path, e, out);
    }
    return out;
  }

  // Records the data file of a label with another name. Images with a label of their name are no candidates; if that
  // label describes another file, reports that no label describes the image. `read`: the label and its data.
  static void note_data(const Candidate& file, const std::vector<std::string>& read, Finding& out) {
    if (!file.entry || read.size() < 2 || same_text(stem_of(name_of(read.back())), stem_of(name_of(read.front()))))
      return;
    out.data = read.back();
    for (const FolderEntry& e : file.folder->group_of(*file.entry))
      if (!file.named && kind_of(e.name) == FileKind::labelled_image && is_label_of(*file.entry, e.name))
        out.problem = {file.folder->path_of(e.name),
                       fmt::format("its label {} describes {}, another file: what it holds, and where, is unknown",
                                   file.entry->name, name_of(out.data)),
                       false, true};
  }

  // Returns true if no label before this one describes the same file. Two labels may place it differently, and nothing
  // tells the right one: the first is used.
  bool is_only_label(const Candidate& file, const Finding& finding, FoundFiles& found) {
    if (finding.data.empty()) return true;
    const std::string& label = label_of_data_.try_emplace(finding.data, file.path).first->second;
    if (label == file.path) return true;
    found.problems.push_back(
        {file.path, fmt::format("describes {}, as does {}, which is used", name_of(finding.data), name_of(label)),
         false, true});
    return false;
  }

  // Records why a file cannot be used, and where it lies if that can be found out: requests there then name it.
  static void describe_problem(const std::string& path, const DataError& e, Finding& out) {
    // Keep the file's name in the text if another file (a VRT's source) is at fault.
    out.problem = {path, e.file() == path ? e.what_is_wrong() : e.what(), false, false};
    try {
      out.raster = inspect_damaged_raster(path);
      out.problem->located = true;
    } catch (const DataError&) {
      // Its footprint is unknown, too: the catalogue lists the problem only.
    }
  }

  // Adds the findings of one path, in order; rethrows the first exception.
  void collect(const NamedPath& path, FoundFiles& found) {
    found.problems.insert(found.problems.end(), path.problems.begin(), path.problems.end());
    for (std::size_t i = path.first; i < path.past_last; ++i) {
      if (findings_[i].thrown) std::rethrow_exception(findings_[i].thrown);
      if (findings_[i].unlabelled && !is_named_by_a_label(candidates_[i]))
        found.problems.push_back(
            {candidates_[i].path, "its label is missing: what it holds, and where, is unknown", false, true});
    }
    for (std::size_t i = path.first; i < path.past_last; ++i) {
      Finding& finding = findings_[i];
      if (finding.problem) found.problems.push_back(*finding.problem);
      if (finding.side_layer) found.side_layers.push_back(*finding.side_layer);
      if (finding.raster && is_only_label(candidates_[i], finding, found) &&
          is_new(candidates_[i], finding.raster->path))
        found.rasters.push_back(std::move(*finding.raster));
    }
  }

  // Returns true for a file's first occurrence. The user may name it twice, or with its folder, or by a link.
  bool is_new(const Candidate& file, const std::string& path) {
    if (!file.folder) return found_files_.insert({nullptr, file.path}).second;
    const FolderEntry* entry = path == file.path ? file.entry : file.folder->find(name_of(path));
    if (entry && !entry->link) {
      const std::string*& folder = canonical_[file.folder];
      if (!folder) folder = &*real_folders_.insert(fs::weakly_canonical(file.folder->path_of(".")).string()).first;
      return found_files_.insert({folder, entry->name}).second;
    }
    const fs::path real = fs::weakly_canonical(path);
    const std::string& name = linked_names_.emplace_back(real.filename().string());
    return found_files_.insert({&*real_folders_.insert(real.parent_path().string()).first, name}).second;
  }

  // Returns true if any label names an image that has no label of its own name. May read all labels of the image's
  // folder, once.
  bool is_named_by_a_label(const Candidate& image) {
    const auto [found, first] = named_images_.try_emplace(image.folder);
    if (first) {
      std::vector<const FolderEntry*> labels;
      for (const FolderEntry& e : image.folder->entries())
        if (kind_of(e.name) == FileKind::label) labels.push_back(&e);
      std::vector<std::vector<std::string>> names(labels.size());
      in_parallel_pieces(labels.size(), 64, [&](std::size_t from, std::size_t to) {
        for (std::size_t i = from; i < to; ++i) names[i] = files_named_by(image.folder->path_of(labels[i]->name));
      });
      for (const auto& label_names : names) found->second.insert(label_names.begin(), label_names.end());
    }
    return found->second.contains(lower(name_of(image.path)));
  }

  const std::vector<std::string>& paths_;
  Folders folders_;
  std::vector<Candidate> candidates_;
  std::vector<Finding> findings_;  // by candidate
  std::vector<NamedPath> named_paths_;
  std::unordered_map<std::string, std::string>
      label_of_data_;  // label of each data file with another name than its label
  // Real folder and name of each file found so far. The texts live in real_folders_, linked_names_ and the candidates.
  struct FileHash {
    std::size_t operator()(const std::pair<const std::string*, std::string_view>& file) const {
      return std::hash<std::string_view>()(file.second) ^ std::hash<const std::string*>()(file.first);
    }
  };
  std::unordered_set<std::pair<const std::string*, std::string_view>, FileHash> found_files_;
  std::unordered_set<std::string> real_folders_;
  std::list<std::string> linked_names_;
  std::unordered_map<const FolderFiles*, const std::string*> canonical_;
  // Lower-case names of files that any label names, by folder.
  std::unordered_map<const FolderFiles*, std::unordered_set<std::string>> named_images_;
};

}  // namespace

FoundFiles find_files(const std::vector<std::string>& paths) { return Opening(paths).run(); }

}  // namespace selenograph::dem
