#include "server/campaign/check.h"

#include <fmt/format.h>

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <map>
#include <mutex>
#include <optional>
#include <set>
#include <stdexcept>
#include <unordered_map>

#include "api/encode/negotiate.h"
#include "dem/base/parallel.h"
#include "server/campaign/campaign.h"
#include "server/campaign/journal.h"
#include "server/campaign/sha256.h"
#include "server/campaign/tar.h"

namespace selenograph::server {
namespace {

namespace fs = std::filesystem;

// A frame's file, or a member of a tar.
struct Found {
  std::string file;  // of the folder
  std::string name;  // of the frame
  std::uint64_t bytes = 0;
  std::string sha256;  // of a member; a file is read when it is compared
};

// "000001.npz" and "npz": "000001".
std::optional<std::string> without_suffix(const std::string& file, std::string_view suffix) {
  if (file.size() <= suffix.size() + 1 || !file.ends_with(suffix) || file[file.size() - suffix.size() - 1] != '.')
    return std::nullopt;
  return file.substr(0, file.size() - suffix.size() - 1);
}

// The name of the frame that a file holds by its suffix.
std::optional<std::string> frame_in(const std::string& file) {
  for (const api::Representation& r : api::representations())
    if (auto name = without_suffix(file, r.extension)) return name;
  return std::nullopt;
}

std::string sha256_of_file(const std::string& path) {
  std::ifstream file(path, std::ios::binary);
  Sha256 digest;
  std::vector<char> buffer(std::size_t{1} << 20);
  while (file.read(buffer.data(), static_cast<std::streamsize>(buffer.size())) || file.gcount() > 0)
    digest.add({buffer.data(), static_cast<std::size_t>(file.gcount())});
  if (file.bad() || !file.eof()) throw std::runtime_error(path + ": cannot be read");
  return digest.hex();
}

class Check {
 public:
  Check(const Manifest& manifest, std::string folder)
      : manifest_(manifest), folder_(std::move(folder)), record_(folder_) {
    result_.tars = record_.format() == kWebDataset;
  }

  CheckResult run() {
    list();
    read_tars();
    compare_lines();
    for (const auto& [name, places] : found_)
      if (!known_.contains(name))
        for (const Found& place : places) extra(place.file, fmt::format("no line is called \"{}\"", name));
    std::stable_sort(result_.faults.begin(), result_.faults.end(), [](const FoundFault& a, const FoundFault& b) {
      return (a.line ? a.line->number : ~std::size_t{0}) < (b.line ? b.line->number : ~std::size_t{0});
    });
    return std::move(result_);
  }

 private:
  std::string path_of(const std::string& file) const { return (fs::path(folder_) / file).string(); }

  void list() {
    if (!fs::is_directory(folder_)) throw std::runtime_error(folder_ + ": is not a folder");
    for (const fs::directory_entry& entry : fs::directory_iterator(folder_)) {
      const std::string file = entry.path().filename().string();
      if (!entry.is_regular_file()) continue;
      if (file.ends_with(".tar")) {
        tars_.push_back(file);
      } else if (const auto name = frame_in(file)) {
        found_[*name].push_back({file, *name, entry.file_size(), {}});
      } else if (file.ends_with(".tar.part") || file.find(".part-") != std::string::npos) {
        extra(file, "was not finished");
      }
    }
  }

  void read_tars() {
    std::sort(tars_.begin(), tars_.end());
    in_parallel(tars_.size(), [&](std::size_t i) {
      const std::string& tar = tars_[i];
      std::vector<Found> members;
      std::string why;
      try {
        const std::string all =
            read_tar(path_of(tar), [&](const std::string& member, std::uint64_t bytes, const std::string& sha256) {
              members.push_back({tar, frame_in(member).value_or(member), bytes, sha256});
            });
        const DoneTar* done = record_.tar(tar);
        if (done && done->sha256 != all) why = fmt::format("its SHA-256 is {}, not {}", all, done->sha256);
      } catch (const std::runtime_error& e) {
        why = e.what();
      }
      const std::lock_guard lock(mutex_);
      for (Found& member : members) found_[member.name].push_back(std::move(member));
      if (!why.empty()) damaged_tars_[tar] = why;
    });
    for (const std::string& tar : tars_)
      if (!record_.tar(tar)) extra(tar, "no journal knows it");
    for (const auto& [tar, why] : damaged_tars_) result_.faults.push_back({Fault::damaged, nullptr, tar, why});
  }

  void compare_lines() {
    std::vector<const ManifestLine*> lines;
    for (const ManifestLine& line : manifest_.lines()) {
      if (line.problem) {
        fault(Fault::bad, line, "", line.problem->value("detail", ""));
      } else {
        lines.push_back(&line);
        known_.insert(line.name);
      }
    }
    in_parallel(lines.size(), [&](std::size_t i) { compare(*lines[i]); });
  }

  void compare(const ManifestLine& line) {
    const auto found = found_.find(line.name);
    const DoneFrame* done = record_.frame(line.name);
    if (found == found_.end()) return compare_absent(line, done);
    const std::string right =
        done ? (done->tar.empty() ? line.name + "." + record_.format() : done->tar) : found->second.front().file;
    const Found* here = nullptr;
    for (const Found& other : found->second) {
      if (other.file == right && !here) {
        here = &other;
      } else {
        fault(Fault::doubled, line, other.file, "is in " + other.file + ", too");
      }
    }
    if (!here) return compare_absent(line, done);
    const Found& place = *here;
    if (!done) return fault(Fault::damaged, line, place.file, "no journal knows it");
    if (done->request_sha256 != line.request_sha256)
      return fault(Fault::damaged, line, place.file, "was made from another request");
    if (const auto tar = damaged_tars_.find(place.file); tar != damaged_tars_.end())
      return fault(Fault::damaged, line, place.file, tar->second);
    if (place.bytes != done->bytes)
      return fault(Fault::damaged, line, place.file, fmt::format("has {} bytes, not {}", place.bytes, done->bytes));
    const std::string sha256 = place.sha256.empty() ? sha256_of_file(path_of(place.file)) : place.sha256;
    if (sha256 != done->sha256)
      return fault(Fault::damaged, line, place.file, fmt::format("its SHA-256 is {}, not {}", sha256, done->sha256));
    const std::lock_guard lock(mutex_);
    ++result_.good;
  }

  void compare_absent(const ManifestLine& line, const DoneFrame* done) {
    const LineWithoutFrame* without = record_.without_frame(line);
    const int status = without ? without->problem.value("status", 0) : 0;
    const std::string detail = without ? without->problem.value("detail", "") : "";
    if (without && status < 500) return fault(Fault::bad, line, "", detail);
    fault(Fault::missing, line, "", without ? detail : done ? "its file is gone" : "was not rendered");
  }

  void fault(Fault fault, const ManifestLine& line, const std::string& file, const std::string& why) {
    const std::lock_guard lock(mutex_);
    result_.faults.push_back({fault, &line, file, why});
  }
  void extra(const std::string& file, const std::string& why) {
    result_.faults.push_back({Fault::extra, nullptr, file, why});
  }

  const Manifest& manifest_;
  const std::string folder_;
  const Record record_;
  std::mutex mutex_;
  std::vector<std::string> tars_;
  std::map<std::string, std::string> damaged_tars_;  // and why
  std::map<std::string, std::vector<Found>> found_;  // by the frame's name
  std::set<std::string> known_;
  CheckResult result_;
};

}  // namespace

std::string_view fault_name(Fault fault) {
  switch (fault) {
    case Fault::missing:
      return "missing";
    case Fault::damaged:
      return "damaged";
    case Fault::doubled:
      return "doubled";
    case Fault::bad:
      return "bad";
    case Fault::extra:
      return "extra";
  }
  throw std::logic_error("no such fault");
}

std::size_t CheckResult::count(Fault fault) const {
  return static_cast<std::size_t>(
      std::count_if(faults.begin(), faults.end(), [&](const FoundFault& f) { return f.fault == fault; }));
}

CheckResult check_campaign(const Manifest& manifest, const std::string& folder) {
  return Check(manifest, folder).run();
}

}  // namespace selenograph::server
