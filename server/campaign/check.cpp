#include "server/campaign/check.h"

#include <fmt/format.h>

#include <filesystem>
#include <fstream>
#include <map>
#include <optional>
#include <stdexcept>
#include <unordered_map>

#include "dem/base/parallel.h"
#include "server/campaign/journal.h"
#include "server/campaign/sha256.h"
#include "server/campaign/tar.h"

namespace selenograph::server {
namespace {

namespace fs = std::filesystem;

// Size and hash of a member's content.
struct Digest {
  std::uint64_t bytes = 0;
  std::string sha256;
};

// Contents of a tar, by the names of its members, or the reason why it cannot be trusted.
struct Tar {
  std::unordered_map<std::string, Digest> members;
  std::string damage;  // empty: none
};

std::string sha256_of_file(const std::string& path) {
  std::ifstream file(path, std::ios::binary);
  Sha256 digest;
  std::vector<char> buffer(std::size_t{1} << 20);
  while (file.read(buffer.data(), static_cast<std::streamsize>(buffer.size())) || file.gcount() > 0)
    digest.add({buffer.data(), static_cast<std::size_t>(file.gcount())});
  if (file.bad() || !file.eof()) throw std::runtime_error(path + ": cannot be read");
  return digest.hex();
}

std::string wrong_sha256(const std::string& actual, const std::string& expected) {
  return fmt::format("its SHA-256 is {}, not {}", actual, expected);
}

class Check {
 public:
  Check(const Manifest& manifest, std::string folder)
      : manifest_(manifest), folder_(std::move(folder)), record_(folder_) {
    if (!fs::is_directory(folder_)) throw std::runtime_error(folder_ + ": is not a folder");
  }

  CheckResult run() {
    read_tars();
    const std::vector<ManifestLine>& lines = manifest_.lines();
    std::vector<std::optional<LineNotDone>> findings(lines.size());
    in_parallel(lines.size(), [&](std::size_t i) { findings[i] = check(lines[i]); });
    CheckResult result;
    for (std::optional<LineNotDone>& finding : findings)
      if (finding)
        result.not_done.push_back(std::move(*finding));
      else
        ++result.done;
    return result;
  }

 private:
  std::string path_of(const std::string& file) const { return (fs::path(folder_) / file).string(); }

  // Reads each tar once, although it holds many frames.
  void read_tars() {
    for (const ManifestLine& line : manifest_.lines())
      if (const DoneFrame* done = record_.frame(line.name); done && done->is_in_tar()) tars_[done->file];
    std::vector<std::map<std::string, Tar>::iterator> entries;
    for (auto entry = tars_.begin(); entry != tars_.end(); ++entry) entries.push_back(entry);
    in_parallel(entries.size(), [&](std::size_t i) {
      const std::string& file = entries[i]->first;
      if (fs::exists(path_of(file))) entries[i]->second = read(file);
    });
  }

  // Reads a tar whole, and compares its hash with the journal's.
  Tar read(const std::string& file) const {
    Tar tar;
    try {
      const std::string sha256 =
          read_tar(path_of(file), [&](const auto& name, std::uint64_t bytes, const auto& digest) {
            tar.members[name] = {bytes, digest};
          });
      const DoneTar* done = record_.tar(file);
      if (done && done->sha256 != sha256) tar.damage = wrong_sha256(sha256, done->sha256);
    } catch (const std::runtime_error& e) {
      tar.damage = e.what();
    }
    return tar;
  }

  // Returns nothing if the line's frame is there and undamaged.
  std::optional<LineNotDone> check(const ManifestLine& line) const {
    if (line.problem) return LineNotDone{&line, "", line.problem->value("detail", ""), true};
    const DoneFrame* done = record_.frame(line.name);
    if (!done) return without_record(line);
    // Returns the finding about a file that is there but is not the line's frame.
    const auto refuse = [&](const std::string& why) { return LineNotDone{&line, done->file, why}; };
    if (!fs::exists(path_of(done->file))) return LineNotDone{&line, "", "its file is gone"};
    if (done->request_sha256 != line.request_sha256) return refuse("was made from another request");
    if (done->is_in_tar()) {
      const Tar& tar = tars_.at(done->file);
      if (!tar.damage.empty()) return refuse(tar.damage);
      const auto member = tar.members.find(line.name + ".npz");
      if (member == tar.members.end()) return refuse("is not in " + done->file);
      if (member->second.sha256 != done->sha256) return refuse(wrong_sha256(member->second.sha256, done->sha256));
      return std::nullopt;
    }
    const std::uint64_t bytes = fs::file_size(path_of(done->file));
    if (bytes != done->bytes) return refuse(fmt::format("has {} bytes, not {}", bytes, done->bytes));
    const std::string sha256 = sha256_of_file(path_of(done->file));
    if (sha256 != done->sha256) return refuse(wrong_sha256(sha256, done->sha256));
    return std::nullopt;
  }

  // Explains why the journals have no frame of a line.
  LineNotDone without_record(const ManifestLine& line) const {
    if (const LineWithoutFrame* without = record_.without_frame(line)) {
      const bool is_bad = without->problem.value("status", 0) < 500;
      return {&line, "", without->problem.value("detail", ""), is_bad};
    }
    const std::string file = line.name + fs::path(record_.any_file()).extension().string();
    if (!record_.any_file().empty() && fs::exists(path_of(file))) return {&line, file, "no journal has its file"};
    return {&line, "", "was not rendered"};
  }

  const Manifest& manifest_;
  const std::string folder_;
  const Record record_;
  std::map<std::string, Tar> tars_;  // by file, those of the manifest's frames
};

}  // namespace

CheckResult check_campaign(const Manifest& manifest, const std::string& folder) {
  return Check(manifest, folder).run();
}

}  // namespace selenograph::server
