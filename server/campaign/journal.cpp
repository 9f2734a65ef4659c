#include "server/campaign/journal.h"

#include <fmt/format.h>
#include <spdlog/spdlog.h>

#include <algorithm>
#include <chrono>
#include <filesystem>
#include <utility>
#include <vector>

#include "api/message/json_text.h"
#include "dem/files/files.h"
#include "server/service/log.h"

namespace selenograph::server {
namespace {

namespace fs = std::filesystem;
using OrderedJson = nlohmann::ordered_json;

constexpr std::string_view kPrefix = "journal-", kSuffix = ".jsonl";

bool is_journal(const std::string& name) { return name.starts_with(kPrefix) && name.ends_with(kSuffix); }

std::string key_of(const std::string& name, const std::string& request_sha256) { return name + " " + request_sha256; }

// Replaces the entry unless it is later than the new one.
template <typename Entry>
void put_later(std::unordered_map<std::string, Entry>& entries, const std::string& key, Entry&& entry) {
  const auto [found, is_new] = entries.try_emplace(key);
  if (is_new || found->second.time <= entry.time) found->second = std::move(entry);
}

// Returns the offset behind the last newline.
std::uint64_t size_of_complete_lines(const GrowingFile& file) {
  constexpr std::size_t kBlockBytes = 1 << 16;
  for (std::uint64_t end = file.size(); end > 0;) {
    const std::uint64_t begin = end > kBlockBytes ? end - kBlockBytes : 0;
    const std::string block = file.read(begin, end - begin);
    if (const std::size_t newline = block.rfind('\n'); newline != std::string::npos) return begin + newline + 1;
    end = begin;
  }
  return 0;
}

std::string journal_name(const Shard& shard) {
  return fmt::format("{}{:05}-of-{:05}{}", kPrefix, shard.index, shard.of, kSuffix);
}

}  // namespace

Record::Record(const std::string& folder, std::string made_by) : made_by_(std::move(made_by)) {
  if (!fs::exists(folder)) return;
  std::vector<std::string> journals;
  for (const fs::directory_entry& entry : fs::directory_iterator(folder))
    if (const std::string name = entry.path().filename().string(); is_journal(name)) journals.push_back(name);
  std::sort(journals.begin(), journals.end());
  for (const std::string& name : journals) {
    const std::string path = in_folder(folder, name), text = dem::read_whole(path);
    // An incomplete last line, without a newline, is not read.
    std::size_t number = 0, begin = 0;
    for (std::size_t end = text.find('\n'); end != std::string::npos; end = text.find('\n', begin)) {
      ++number;
      try {
        add(OrderedJson::parse(std::string_view(text).substr(begin, end - begin)));
      } catch (const OrderedJson::exception&) {
        spdlog::warn("{}, line {}: skipped, because it is not a journal line", path, number);
      }
      begin = end + 1;
    }
  }
}

// Adds a journal line, whose members tell its kind (journal.h): "plan" is a tar's, "problem" that of a line without a
// frame. Throws OrderedJson::exception for a line that lacks a member.
void Record::add(const OrderedJson& line) {
  const std::string time = line.at("time"), made_by = line.at("made_by");
  if (line.contains("plan")) {
    const std::string tar = line.at("tar");
    put_later(tars_, tar,
              DoneTar{tar, line.at("plan"), line.at("sha256"), line.at("bytes"), line.at("frames"), time, made_by});
    return;
  }
  const std::string name = line.at("name"), request = line.at("request_sha256");
  if (line.contains("problem")) {
    put_later(without_, key_of(name, request),
              LineWithoutFrame{name, line.at("line"), request, line.at("problem"), time, made_by});
    return;
  }
  DoneFrame frame{.name = name,
                  .line = line.at("line"),
                  .request_sha256 = request,
                  .content_hash = line.at("content_hash").is_string() ? line.at("content_hash") : OrderedJson(""),
                  .sha256 = line.at("sha256"),
                  .bytes = line.at("bytes"),
                  .ms = line.at("ms"),
                  .file = line.at("file"),
                  .offset = line.value("offset", std::uint64_t{0}),
                  .time = time,
                  .made_by = made_by};
  any_file_ = frame.file;
  put_later(frames_, name, std::move(frame));
}

const DoneFrame* Record::frame(const std::string& name) const {
  const auto found = frames_.find(name);
  return found == frames_.end() || !counts(found->second.made_by) ? nullptr : &found->second;
}

const LineWithoutFrame* Record::without_frame(const ManifestLine& line) const {
  const auto found = without_.find(key_of(line.name, line.request_sha256));
  if (found == without_.end()) return nullptr;
  const auto frame = frames_.find(line.name);  // a later frame of the same request ends the problem
  const bool is_solved = frame != frames_.end() && frame->second.request_sha256 == line.request_sha256 &&
                         frame->second.time >= found->second.time;
  return is_solved ? nullptr : &found->second;
}

const DoneTar* Record::tar(const std::string& name) const {
  const auto found = tars_.find(name);
  return found == tars_.end() || !counts(found->second.made_by) ? nullptr : &found->second;
}

Journal::Journal(const std::string& folder, const Shard& shard, std::string made_by)
    : made_by_(std::move(made_by)), file_(in_folder(folder, journal_name(shard))) {
  if (const std::uint64_t size = size_of_complete_lines(file_); size < file_.size()) file_.cut(size);
}

void Journal::add_line(const OrderedJson& members) {
  const std::lock_guard lock(mutex_);
  OrderedJson line{{"time", utc_text(std::chrono::system_clock::now())}, {"made_by", made_by_}};
  line.update(members);
  file_.append(api::json_line(line));
}

void Journal::add(const DoneFrame& frame) {
  OrderedJson line{{"name", frame.name},
                   {"line", frame.line},
                   {"request_sha256", frame.request_sha256},
                   {"content_hash", frame.content_hash.empty() ? OrderedJson() : OrderedJson(frame.content_hash)},
                   {"sha256", frame.sha256},
                   {"bytes", frame.bytes},
                   {"ms", frame.ms},
                   {"file", frame.file}};
  if (frame.is_in_tar()) line["offset"] = frame.offset;
  add_line(line);
}

void Journal::add(const LineWithoutFrame& line) {
  add_line(OrderedJson{
      {"name", line.name}, {"line", line.line}, {"request_sha256", line.request_sha256}, {"problem", line.problem}});
}

void Journal::add(const DoneTar& tar) {
  add_line(OrderedJson{
      {"tar", tar.tar}, {"plan", tar.plan}, {"sha256", tar.sha256}, {"bytes", tar.bytes}, {"frames", tar.frames}});
}

}  // namespace selenograph::server
