#include "server/campaign/journal.h"

#include <fmt/format.h>
#include <spdlog/spdlog.h>

#include <algorithm>
#include <filesystem>
#include <list>
#include <stdexcept>

#include "api/message/json_text.h"
#include "dem/files/files.h"

namespace selenograph::server {
namespace {

namespace fs = std::filesystem;
using OrderedJson = nlohmann::ordered_json;

constexpr std::string_view kPrefix = "journal-", kSuffix = ".jsonl";

bool is_journal(const std::string& name) { return name.starts_with(kPrefix) && name.ends_with(kSuffix); }

std::string in_folder(const std::string& folder, const std::string& name) { return (fs::path(folder) / name).string(); }

OrderedJson json_of(const Run& run) {
  return {{"run",
           {{"software", run.software},
            {"terrain", run.terrain},
            {"format", run.format},
            {"shard", run.shard},
            {"of", run.of},
            {"manifest_sha256", run.manifest_sha256},
            {"started", run.started}}}};
}

Run run_of(const OrderedJson& run) {
  return {.software = run.at("software"),
          .terrain = run.at("terrain"),
          .format = run.at("format"),
          .shard = run.at("shard"),
          .of = run.at("of"),
          .manifest_sha256 = run.at("manifest_sha256"),
          .started = run.at("started")};
}

std::string key_of(const std::string& name, const std::string& request_sha256) { return name + " " + request_sha256; }

std::size_t offset_in(const std::string& text, std::string_view part) {
  return static_cast<std::size_t>(part.data() - text.data());
}

// Calls each(line, number, offset in `text`) for whole lines that are JSON.
template <typename Each>
void each_line(const std::string& path, std::size_t number, std::string_view text, const Each& each) {
  for (std::size_t at = 0, end = 0; (end = text.find('\n', at)) != std::string_view::npos; at = end + 1, ++number) {
    try {
      each(OrderedJson::parse(text.substr(at, end - at)), number, at);
    } catch (const OrderedJson::exception&) {
      spdlog::warn("{}, line {}: is not a journal line; skipped", path, number);
    }
  }
}

// The offset behind the last newline.
std::uint64_t whole_lines(const GrowingFile& file) {
  constexpr std::size_t kPiece = 1 << 16;
  for (std::uint64_t end = file.size(); end > 0;) {
    const std::uint64_t begin = end > kPiece ? end - kPiece : 0;
    const std::string piece = file.read(begin, end - begin);
    if (const std::size_t at = piece.rfind('\n'); at != std::string::npos) return begin + at + 1;
    end = begin;
  }
  return 0;
}

}  // namespace

std::string journal_name(std::size_t shard, std::size_t of) {
  return fmt::format("{}{:05}-of-{:05}{}", kPrefix, shard, of, kSuffix);
}

// What one process wrote into one journal.
struct Record::Lines {
  Run run;
  std::string path;
  std::size_t first_number = 0;
  std::string_view text;
};

Record::Record(const std::string& folder, const Run* current) {
  if (!fs::exists(folder)) return;
  std::vector<std::string> journals;
  for (const fs::directory_entry& entry : fs::directory_iterator(folder))
    if (const std::string name = entry.path().filename().string(); is_journal(name)) journals.push_back(name);
  std::sort(journals.begin(), journals.end());
  std::list<std::string> texts;
  std::vector<Lines> runs;
  for (const std::string& name : journals) {
    const std::string path = in_folder(folder, name);
    split_into_runs(path, texts.emplace_back(dem::read_whole(path)), runs);
  }
  std::stable_sort(runs.begin(), runs.end(),
                   [](const Lines& a, const Lines& b) { return a.run.started < b.run.started; });
  for (const Lines& lines : runs) {
    format_ = lines.run.format;
    const bool counts = !current || lines.run.same_bytes(*current);
    each_line(lines.path, lines.first_number, lines.text, [&](const OrderedJson& line, std::size_t, std::size_t) {
      if (!line.contains("run")) take(line, counts);
    });
  }
}

void Record::split_into_runs(const std::string& path, const std::string& text, std::vector<Lines>& runs) {
  const std::size_t first = runs.size();
  each_line(path, 1, text, [&](const OrderedJson& line, std::size_t number, std::size_t at) {
    if (!line.contains("run")) return;
    if (runs.size() > first) runs.back().text = runs.back().text.substr(0, at - offset_in(text, runs.back().text));
    runs.push_back({run_of(line.at("run")), path, number, std::string_view(text).substr(at)});
  });
}

void Record::take(const OrderedJson& line, bool counts) {
  if (line.contains("plan")) {
    const DoneTar tar{line.at("tar"), line.at("plan"), line.at("sha256"), line.at("bytes"), line.at("frames")};
    counts ? void(tars_[tar.tar] = tar) : void(tars_.erase(tar.tar));
    return;
  }
  const std::string name = line.at("name"), request = line.at("request_sha256");
  if (line.contains("problem")) {
    without_[key_of(name, request)] = {name, line.at("line"), request, line.at("problem")};
    return;
  }
  DoneFrame frame{.name = name,
                  .line = line.at("line"),
                  .request_sha256 = request,
                  .content_hash = line.at("content_hash").is_string() ? line.at("content_hash") : OrderedJson(""),
                  .sha256 = line.at("sha256"),
                  .bytes = line.at("bytes"),
                  .ms = line.at("ms"),
                  .missing_fraction = {},
                  .tar = line.value("tar", ""),
                  .offset = line.value("offset", std::uint64_t{0})};
  if (line.contains("missing_fraction")) frame.missing_fraction = line.at("missing_fraction").get<double>();
  without_.erase(key_of(name, request));
  if (!counts) {
    frames_.erase(name);
    return;
  }
  frames_[name] = std::move(frame);
}

const DoneFrame* Record::frame(const std::string& name) const {
  const auto found = frames_.find(name);
  return found == frames_.end() ? nullptr : &found->second;
}

const LineWithoutFrame* Record::without_frame(const ManifestLine& line) const {
  const auto found = without_.find(key_of(line.name, line.request_sha256));
  return found == without_.end() ? nullptr : &found->second;
}

const DoneTar* Record::tar(const std::string& name) const {
  const auto found = tars_.find(name);
  return found == tars_.end() ? nullptr : &found->second;
}

Journal::Journal(const std::string& folder, const Run& run)
    : file_(in_folder(folder, journal_name(run.shard, run.of))), run_(run) {
  if (const std::uint64_t whole = whole_lines(file_); whole < file_.size()) file_.cut(whole);
}

void Journal::add_line(const OrderedJson& line) {
  std::string text = api::json_line(line);
  std::lock_guard lock(mutex_);
  if (run_) text.insert(0, api::json_line(json_of(*run_)));
  file_.append(text);
  run_.reset();
}

void Journal::add(const DoneFrame& frame) {
  OrderedJson line{{"name", frame.name},
                   {"line", frame.line},
                   {"request_sha256", frame.request_sha256},
                   {"content_hash", frame.content_hash.empty() ? OrderedJson() : OrderedJson(frame.content_hash)},
                   {"sha256", frame.sha256},
                   {"bytes", frame.bytes},
                   {"ms", frame.ms}};
  if (frame.missing_fraction) line["missing_fraction"] = *frame.missing_fraction;
  if (!frame.tar.empty()) line["tar"] = frame.tar, line["offset"] = frame.offset;
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
