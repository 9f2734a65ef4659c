#include "dem/catalogue/catalogue_opening.h"

#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <exception>
#include <filesystem>
#include <functional>
#include <future>
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
#include "dem/catalogue/saved_catalogue.h"
#include "dem/files/files.h"
#include "dem/files/folder_files.h"
#include "dem/files/labels.h"
#include "dem/files/quantity.h"
#include "dem/gdal/raster.h"
#include "dem/gdal/remote_files.h"
#include "dem/gdal/remote_names.h"

namespace selenograph::dem {
namespace {

namespace fs = std::filesystem;

// A file to look at.
struct Candidate {
  std::string path;
  const FolderFiles* folder = nullptr;  // that lists it; null: of a remote file
  const FolderEntry* entry = nullptr;   // null: not listed there
  bool named = false;                   // by the user: must be usable
};

// What it turned out to be.
struct Finding {
  SavedFile* known = nullptr;        // as it was at an earlier opening
  std::optional<RasterInfo> raster;  // else
  std::optional<SavedFile> keep;     // for the next opening
  std::optional<CatalogueProblem> problem;
  std::optional<SideLayer> side_layer;
  std::string data;         // the file that holds the samples, if its name is not the label's
  bool unlabelled = false;  // an image whose label is missing, unless another's label names it
  std::string trouble;      // for the log
  std::exception_ptr thrown;
};

std::int64_t now_ns() {
  return std::chrono::duration_cast<std::chrono::nanoseconds>(std::chrono::system_clock::now().time_since_epoch())
      .count();
}

// As paths compare, component by component.
bool path_less(const Candidate& a, const Candidate& b) {
  if (a.folder == b.folder) return a.path < b.path;
  const auto rank = [](char c) { return c == '/' ? 0 : static_cast<unsigned char>(c); };
  return std::lexicographical_compare(a.path.begin(), a.path.end(), b.path.begin(), b.path.end(),
                                      [&](char x, char y) { return rank(x) < rank(y); });
}

bool is_label_of(const FolderEntry& entry, std::string_view image) {
  return kind_of(entry.name) == FileKind::label && same_text(stem_of(entry.name), stem_of(image));
}

// Returns whether a file is a PDS4 label of a raster that only the label describes: a GeoTIFF describes itself.
bool is_lone_pds4_label(const FolderFiles& folder, const FolderEntry& entry) {
  if (!same_text(entry.name.substr(stem_of(entry.name).size()), ".xml")) return false;
  const auto group = folder.group_of(entry);
  const auto describes_itself = [](const FolderEntry& e) { return kind_of(e.name) == FileKind::georeferenced; };
  return std::none_of(group.begin(), group.end(), describes_itself) && is_pds4_label(folder.path_of(entry.name));
}

// Lists folders.
class Folders {
 public:
  const FolderFiles& of(const std::string& folder) {
    const FolderFiles*& listed = listed_[folder];
    if (!listed) listed = listings_.emplace_back(std::make_unique<FolderFiles>(folder)).get();
    return *listed;
  }

  // The candidates below a folder, in the order of their paths.
  std::vector<Candidate> below(const std::string& folder, std::vector<CatalogueProblem>& problems) {
    std::vector<Candidate> found;
    std::vector<std::string> folders{folder};
    int trouble = 0;
    while (!folders.empty()) {
      const std::string here = std::move(folders.back());
      folders.pop_back();
      const FolderFiles& files = *listings_.emplace_back(std::make_unique<FolderFiles>(here, &folders));
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
    // Names of one product in one folder come in this order already.
    if (!std::is_sorted(found.begin(), found.end(), path_less)) std::sort(found.begin(), found.end(), path_less);
    return found;
  }

 private:
  std::vector<std::unique_ptr<FolderFiles>> listings_;  // all, for the candidates point at them
  std::map<std::string, const FolderFiles*> listed_;    // of files that the user names
};

// The files that a file's description was read from, beside the group that bears its name.
std::vector<std::pair<std::string, std::uint64_t>> other_files(const Candidate& file,
                                                               const std::vector<std::string>& read,
                                                               std::int64_t& changed_ns) {
  std::vector<std::pair<std::string, std::uint64_t>> others;
  const auto group = file.folder->group_of(*file.entry);
  for (const std::string& path : read) {
    if (std::any_of(group.begin(), group.end(),
                    [&](const FolderEntry& e) { return file.folder->path_of(e.name) == path; }))
      continue;
    const auto stamp = stamp_of(path);
    changed_ns = std::max(changed_ns, stamp ? stamp->changed_ns : now_ns());
    others.emplace_back(path, stamp ? stamp->hash : 0);
  }
  return others;
}

class Opening {
 public:
  Opening(const std::vector<std::string>& paths, const CatalogueOptions& options)
      : paths_(paths), options_(options), unsettled_ns_(now_ns() - options.settling.count()) {}

  FoundFiles run() {
    std::future<void> read =
        std::async(std::launch::async, [this] { saved_.read(options_.cache_dir, paths_, options_.log); });
    list();
    read.get();
    look();
    FoundFiles found;
    for (const Part& part : parts_) collect(part, found);
    keep();
    found.rasters.reserve(usable_.size());
    // Last: what was kept points at them.
    for (Finding* finding : usable_)
      found.rasters.push_back(std::move(finding->known ? *finding->known->raster : *finding->raster));
    found.inspected = static_cast<std::size_t>(
        std::count_if(findings_.begin(), findings_.end(), [](const Finding& f) { return !f.known && !f.unlabelled; }));
    return found;
  }

 private:
  // What one path of the user's stands for.
  struct Part {
    std::size_t first, past_last;  // of the candidates
    std::vector<CatalogueProblem> problems;
  };

  void list() {
    for (const std::string& path : paths_) {
      Part part{candidates_.size(), 0, {}};
      std::error_code error;
      if (is_remote(path)) {
        candidates_.push_back({path, nullptr, nullptr, true});
      } else if (fs::is_directory(path, error)) {
        std::vector<Candidate> below = folders_.below(path, part.problems);
        std::move(below.begin(), below.end(), std::back_inserter(candidates_));
      } else {
        const FolderFiles& folder = folders_.of(fs::path(path).parent_path().string());
        candidates_.push_back({path, &folder, folder.find(name_of(path)), true});
      }
      part.past_last = candidates_.size();
      parts_.push_back(std::move(part));
    }
    findings_.resize(candidates_.size());
  }

  // All at once. What one of them throws is thrown by collect(), so that the first of them is told, whoever was faster.
  void look() {
    const auto look_at = [&](std::size_t i) {
      try {
        findings_[i] = candidates_[i].folder ? find(candidates_[i]) : find_remote(candidates_[i]);
      } catch (...) {
        findings_[i].thrown = std::current_exception();
      }
    };
    std::vector<std::size_t> remote;
    for (std::size_t i = 0; i < candidates_.size(); ++i)
      if (!candidates_[i].folder) remote.push_back(i);
    in_parallel_pieces(candidates_.size(), 64, [&](std::size_t first, std::size_t past_last) {
      for (std::size_t i = first; i < past_last; ++i)
        if (candidates_[i].folder) look_at(i);
    });
    on_own_threads(kConnections, [&] { in_parallel(remote.size(), [&](std::size_t k) { look_at(remote[k]); }); });
  }

  SavedFile* still_valid(const std::string& path, std::uint64_t stamp) {
    SavedFile* known = saved_.find(path);
    if (!known || known->stamp != stamp) return nullptr;
    const bool same = std::all_of(known->others.begin(), known->others.end(), [](const auto& other) {
      const auto now = stamp_of(other.first);
      return now && now->hash == other.second;
    });
    return same ? known : nullptr;
  }

  Finding find(const Candidate& file) {
    Finding out;
    std::optional<FileStamp> stamp;
    if (file.entry) stamp = file.folder->stamp(*file.entry);  // before it is read: a later change has another one
    if (stamp) out.known = still_valid(file.path, stamp->hash);
    // A file in a folder may be about something else; one that the user names may not.
    if (out.known && file.named && !out.known->raster) out.known = nullptr;
    if (out.known) return out;
    if (!file.named && kind_of(file.path) == FileKind::labelled_image && !begins_with_label(file.path)) {
      out.unlabelled = true;
      return out;
    }
    std::vector<std::string> read;
    bool other_product = false;
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
      other_product = describes_other_product(file.path);
      if (!other_product) describe_problem(file.path, e, out);
    }
    // What a VRT names may change, and what is at fault may be mended, where nobody looks.
    if (!stamp || out.problem || out.side_layer || (out.raster && out.raster->format == "VRT")) return out;
    std::int64_t changed_ns = stamp->changed_ns;
    SavedFile keep{file.path, stamp->hash, other_files(file, read, changed_ns), {}};
    if (changed_ns == 0 || changed_ns > unsettled_ns_) return out;
    if (!other_product) keep.raster = out.raster;
    out.keep = std::move(keep);
    return out;
  }

  // Notes the file that a label of another name describes. An image is left out where a label bears its name: if that
  // label describes another file, nothing describes the image. `read`: the label and its data.
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

  // Returns whether no other label describes the same file. Two of them may place it differently, and nobody knows
  // which is right: the first is used.
  bool is_only_label(const Candidate& file, const Finding& finding, FoundFiles& found) {
    const SavedFile* saved = finding.known;
    const std::string& data = saved && !saved->others.empty() ? saved->others.front().first : finding.data;
    if (data.empty()) return true;
    const std::string& label = label_of_data_.try_emplace(data, file.path).first->second;
    if (label == file.path) return true;
    found.problems.push_back({file.path,
                              fmt::format("describes {}, as does {}, which is used", name_of(data), name_of(label)),
                              false, true});
    return false;
  }

  static void describe_problem(const std::string& path, const DataError& e, Finding& out) {
    // Another file's fault (a VRT's source) is told with its name.
    out.problem = {path, e.file() == path ? e.what_is_wrong() : e.what(), false, false};
    try {
      out.raster = inspect_damaged_raster(path);
      out.problem->located = true;
    } catch (const DataError&) {
      // Not even its place is known: the problem says so.
    }
  }

  // A server that can't be reached says nothing about its files: they are as they were.
  Finding find_remote(const Candidate& file) {
    Finding out;
    FileState state;
    try {
      state = remote_state(file.path);
    } catch (const SystemFault& fault) {
      out.known = saved_.find(file.path);
      if (!out.known) throw;
      out.trouble = fault.what() + std::string("; taken for what it was");
      return out;
    }
    const std::uint64_t stamp = stamp_of(state);
    out.known = still_valid(file.path, stamp);
    if (out.known) return out;
    out.raster = inspect_raster(file.path);
    // Servers tell whole seconds; one that tells neither time nor ETag can't be asked whether a file is still the same.
    if (state.modified_ns != 0 ? state.modified_ns <= unsettled_ns_ : state.identity != 0)
      out.keep = SavedFile{file.path, stamp, {}, out.raster};
    return out;
  }

  void collect(const Part& part, FoundFiles& found) {
    found.problems.insert(found.problems.end(), part.problems.begin(), part.problems.end());
    for (std::size_t i = part.first; i < part.past_last; ++i) {
      if (findings_[i].thrown) std::rethrow_exception(findings_[i].thrown);
      if (!findings_[i].trouble.empty() && options_.log) options_.log(findings_[i].trouble);
      if (findings_[i].unlabelled && !is_named_by_a_label(candidates_[i]))
        found.problems.push_back(
            {candidates_[i].path, "its label is missing: what it holds, and where, is unknown", false, true});
    }
    for (std::size_t i = part.first; i < part.past_last; ++i) {
      Finding& finding = findings_[i];
      if (finding.problem) found.problems.push_back(*finding.problem);
      if (finding.side_layer) found.side_layers.push_back(*finding.side_layer);
      const RasterInfo* raster = finding.known && finding.known->raster ? &*finding.known->raster
                                 : finding.raster                       ? &*finding.raster
                                                                        : nullptr;
      if (raster && is_only_label(candidates_[i], finding, found) && is_new(candidates_[i], raster->path))
        usable_.push_back(&finding);
    }
  }

  // Whether a file is met for the first time: it may be given twice, or with its folder, or by a link.
  bool is_new(const Candidate& file, const std::string& path) {
    if (!file.folder) return seen_.insert({nullptr, path}).second;
    const FolderEntry* entry = path == file.path ? file.entry : file.folder->find(name_of(path));
    if (entry && !entry->link) {
      const std::string*& folder = canonical_[file.folder];
      if (!folder) folder = &*folders_seen_.insert(fs::weakly_canonical(file.folder->path_of(".")).string()).first;
      return seen_.insert({folder, entry->name}).second;
    }
    const fs::path real = fs::weakly_canonical(path);
    const std::string& name = real_names_.emplace_back(real.filename().string());
    return seen_.insert({&*folders_seen_.insert(real.parent_path().string()).first, name}).second;
  }

  // Asked for only where an image has no label of its name: all labels of the folder may have to be read.
  bool is_named_by_a_label(const Candidate& image) {
    if (!others_known_) {
      others_known_ = true;
      for (const Finding& finding : findings_)
        if (const SavedFile* file = kept(finding))
          for (const auto& other : file->others) others_.insert(other.first);
    }
    if (others_.contains(image.path)) return true;
    const auto [found, first] = named_images_.try_emplace(image.folder);
    if (first) {
      std::vector<const FolderEntry*> labels;
      for (const FolderEntry& e : image.folder->entries())
        if (kind_of(e.name) == FileKind::label) labels.push_back(&e);
      std::vector<std::vector<std::string>> names(labels.size());
      in_parallel_pieces(labels.size(), 64, [&](std::size_t from, std::size_t to) {
        for (std::size_t i = from; i < to; ++i) names[i] = files_named_by(image.folder->path_of(labels[i]->name));
      });
      for (const auto& of_one : names) found->second.insert(of_one.begin(), of_one.end());
    }
    return found->second.contains(lower(name_of(image.path)));
  }

  static const SavedFile* kept(const Finding& finding) {
    return finding.known ? finding.known : finding.keep ? &*finding.keep : nullptr;
  }

  void keep() {
    const auto known = static_cast<std::size_t>(
        std::count_if(findings_.begin(), findings_.end(), [](const Finding& f) { return f.known != nullptr; }));
    const bool fresh =
        std::any_of(findings_.begin(), findings_.end(), [](const Finding& f) { return f.keep.has_value(); });
    if (!fresh && known == saved_.size()) return;
    std::vector<const SavedFile*> files;
    std::unordered_set<std::string_view> paths;
    for (const Finding& finding : findings_)
      if (const SavedFile* file = kept(finding); file && paths.insert(file->path).second) files.push_back(file);
    if (fresh || files.size() != saved_.size()) saved_.replace(files);
  }

  const std::vector<std::string>& paths_;
  const CatalogueOptions& options_;
  const std::int64_t unsettled_ns_;
  SavedCatalogue saved_;
  Folders folders_;
  std::vector<Candidate> candidates_;
  std::vector<Finding> findings_;  // of the candidates
  std::vector<Part> parts_;
  std::vector<Finding*> usable_;
  std::unordered_map<std::string, std::string> label_of_data_;  // labels with other names than their data
  // Folders and names of files met so far; both are kept below, or by folders_ and candidates_.
  struct PlaceHash {
    std::size_t operator()(const std::pair<const std::string*, std::string_view>& place) const {
      return std::hash<std::string_view>()(place.second) ^ std::hash<const std::string*>()(place.first);
    }
  };
  std::unordered_set<std::pair<const std::string*, std::string_view>, PlaceHash> seen_;
  std::unordered_set<std::string> folders_seen_;
  std::list<std::string> real_names_;
  std::unordered_map<const FolderFiles*, const std::string*> canonical_;
  // Images that labels of other names name: found already; and all, by folder.
  bool others_known_ = false;
  std::unordered_set<std::string> others_;
  std::unordered_map<const FolderFiles*, std::unordered_set<std::string>> named_images_;
};

}  // namespace

FoundFiles find_files(const std::vector<std::string>& paths, const CatalogueOptions& options) {
  return Opening(paths, options).run();
}

}  // namespace selenograph::dem
