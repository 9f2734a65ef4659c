#include "server/campaign/check.h"

#include <fmt/format.h>

#include <algorithm>
#include <filesystem>
#include <mutex>
#include <optional>
#include <stdexcept>
#include <unordered_map>

#include "dem/base/parallel.h"
#include "server/campaign/frame_file.h"
#include "server/campaign/tar.h"

namespace selenograph::server {
namespace {

namespace fs = std::filesystem;

class Check {
 public:
  Check(const Manifest& manifest, std::string folder) : manifest_(manifest), folder_(std::move(folder)) {
    if (!fs::is_directory(folder_)) throw std::runtime_error(folder_ + ": is not a folder");
  }

  CheckResult run() {
    read_files();
    for (const ManifestLine& line : manifest_.lines())
      if (std::optional<LineNotDone> finding = check(line))
        result_.not_done.push_back(std::move(*finding));
      else
        ++result_.done;
    return result_;
  }

 private:
  // Reads all files that may hold frames of the manifest: NAME.npz and so on, and tars.
  void read_files() {
    for (const ManifestLine& line : manifest_.lines()) files_[line.name];
    std::vector<std::string> files;
    for (const fs::directory_entry& entry : fs::directory_iterator(folder_)) {
      const std::string file = entry.path().filename().string();
      if (file.ends_with(".tar") || (is_frame(file) && files_.contains(entry.path().stem().string())))
        files.push_back(file);
    }
    std::sort(files.begin(), files.end());  // so that messages do not depend on the file system
    in_parallel(files.size(), [&](std::size_t i) {
      try {
        read(files[i]);
      } catch (const std::runtime_error& e) {
        const std::lock_guard lock(mutex_);
        result_.damaged[files[i]] = e.what();
      }
    });
  }

  static bool is_frame(const std::string& file) {
    for (const char* extension : {".npz", ".png", ".tiff", ".exr"})
      if (file.ends_with(extension)) return true;
    return false;
  }

  // Reads a frame, or a tar's.
  void read(const std::string& file) {
    const std::string path = in_folder(folder_, file);
    if (!file.ends_with(".tar")) return read(file, {path, 0, fs::file_size(path)}, file);
    for (const TarMember& member : list_tar(path)) read(file, {path, member.offset, member.bytes}, member.name);
  }

  // `name`: of the frame's file, or of its member of a tar.
  void read(const std::string& file, const FrameFile& frame, const std::string& name) {
    const auto found = files_.find(fs::path(name).stem().string());
    if (found == files_.end()) return;  // of another manifest
    {
      const std::lock_guard lock(mutex_);
      found->second.push_back(file);
    }
    check_whole(frame);
  }

  // Returns nothing if the line's frame is there once and whole.
  std::optional<LineNotDone> check(const ManifestLine& line) const {
    if (line.problem) return LineNotDone{&line, line.problem->value("detail", ""), true};
    const std::vector<std::string>& files = files_.at(line.name);
    if (files.size() > 1)
      return LineNotDone{&line, fmt::format("is there twice, in {} and {}: remove one", files[0], files[1])};
    if (files.size() == 1 && result_.damaged.contains(files[0])) return LineNotDone{&line, files[0] + " is damaged"};
    if (files.size() == 1) return std::nullopt;
    if (const auto problem = recorded_problem(folder_, manifest_, line))
      return LineNotDone{&line, problem->value("detail", ""), true};
    return LineNotDone{&line, "is not there"};
  }

  const Manifest& manifest_;
  const std::string folder_;
  std::mutex mutex_;
  std::unordered_map<std::string, std::vector<std::string>> files_;  // with a line's frame, by its name
  CheckResult result_;
};

}  // namespace

CheckResult check_campaign(const Manifest& manifest, const std::string& folder) {
  return Check(manifest, folder).run();
}

}  // namespace selenograph::server
