// `selenograph batch` and `selenograph batch verify`: a manifest's frames, and whether they are all there.
#include <fmt/chrono.h>
#include <fmt/format.h>

#include <atomic>
#include <charconv>
#include <chrono>
#include <csignal>
#include <cstdio>
#include <filesystem>
#include <stdexcept>
#include <thread>

#include "api/answers/metadata.h"
#include "api/message/json_text.h"
#include "server/campaign/campaign.h"
#include "server/campaign/check.h"
#include "server/campaign/coco_file.h"
#include "server/campaign/durable_files.h"
#include "server/commands/commands.h"
#include "server/commands/output.h"
#include "server/commands/start.h"

namespace selenograph::server {
namespace {

namespace fs = std::filesystem;

constexpr int kAllDone = 0, kRunAgain = 1, kBadLines = 2;

std::atomic<bool> stop{false};
static_assert(std::atomic<bool>::is_always_lock_free);  // it is set by a signal's handler

// After the first signal the default is back: a second one quits at once.
void stop_on_signal() {
  struct sigaction action {};
  action.sa_handler = [](int) { stop = true; };
  action.sa_flags = static_cast<int>(SA_RESETHAND);
  ::sigaction(SIGINT, &action, nullptr);
  ::sigaction(SIGTERM, &action, nullptr);
}

// "3/16".
Shard shard_of(const std::string& text) {
  Shard shard;
  const char* const end = text.data() + text.size();
  const auto index = std::from_chars(text.data(), end, shard.index);
  const bool slash = index.ec == std::errc() && index.ptr != end && *index.ptr == '/';
  const auto of = slash ? std::from_chars(index.ptr + 1, end, shard.of) : std::from_chars_result{};
  constexpr std::size_t kMost = 100000;
  if (!slash || of.ec != std::errc() || of.ptr != end || shard.of > kMost || shard.index >= shard.of)
    throw std::runtime_error(
        fmt::format("--shard: \"{}\" is not I/N with I from 0 to N - 1 and N up to {}, like 0/16", text, kMost));
  return shard;
}

void need(const std::string& value, const char* what) {
  if (value.empty()) throw std::runtime_error(std::string(what) + " is needed; see --help");
}

std::string utc_now() {
  const auto now = std::chrono::time_point_cast<std::chrono::milliseconds>(std::chrono::system_clock::now());
  const auto seconds = std::chrono::time_point_cast<std::chrono::seconds>(now);
  return fmt::format("{:%Y-%m-%dT%H:%M:%S}.{:03}Z", fmt::gmtime(std::chrono::system_clock::to_time_t(seconds)),
                     (now - seconds).count());
}

Run run_of(const Manifest& manifest, const CampaignOptions& options, std::uint64_t terrain) {
  return {.software = std::string(api::software_version()),
          .terrain = fmt::format("{:016x}", terrain),
          .format = options.format,
          .shard = options.shard.index,
          .of = options.shard.of,
          .manifest_sha256 = manifest.sha256(),
          .started = utc_now()};
}

void print_tally(const CampaignTally& tally, const std::string& folder) {
  fmt::print("{}: {} frames rendered, {} were there\n", folder, tally.rendered, tally.kept);
  if (tally.outside > 0)
    fmt::print("{} of the frames have pixels that look at the Moon outside the data: black, NaN or 65535 there\n",
               tally.outside);
  for (const auto& [text, frames] : tally.warnings) fmt::print("warning, of {} frames: {}\n", frames, text);
  if (tally.bad > 0) fmt::print("{} lines can never be a frame: see the journal\n", tally.bad);
  if (tally.failed > 0)
    fmt::print("{} lines could not be rendered now: see the journal, and run again\n", tally.failed);
  if (tally.interrupted) fmt::print("interrupted: run the same command to go on\n");
}

// Labels of the frames that are there, by an earlier run as well.
void write_labels(const Manifest& manifest, const CampaignOptions& options, const Run& run) {
  std::vector<const ManifestLine*> lines;
  if (options.format == kWebDataset) {
    for (const TarPlan& tar : tars_of(manifest, options.shard, options.frames_per_tar))
      lines.insert(lines.end(), tar.lines.begin(), tar.lines.end());
  } else {
    lines = lines_of(manifest, options.shard);
  }
  const CocoTally tally = write_coco(lines, Record(options.folder, &run), options.shard, options.folder, stop);
  fmt::print("{}: {} annotations of {} frames\n", tally.path, tally.annotations, tally.images);
  if (tally.without > 0)
    fmt::print("{} frames are left out: their requests have no \"labels\": true, or several cameras\n", tally.without);
}

// A line with its name, wherever it stands in another manifest.
std::string named(const Manifest& manifest, const ManifestLine& line) {
  api::Json request = manifest.request(line);
  request["name"] = line.name;
  return api::json_line(request);
}

// What is no frame as it should be makes room for the one that is.
void put_aside(const std::string& folder, const std::string& file) {
  const std::string path = (fs::path(folder) / file).string();
  if (fs::exists(path)) rename_on_disk(path, path + ".damaged");
}

// Lines to render again, each once.
std::string lines_to_rerun(const Manifest& manifest, const CheckResult& result) {
  std::string text;
  for (const FoundFault& fault : result.faults)
    if (fault.line && fault.fault != Fault::bad) text += named(manifest, *fault.line);
  return text;
}

}  // namespace

int batch(const BatchSettings& settings) {
  need(settings.manifest, "MANIFEST.jsonl");
  need(settings.output, "--output DIR");
  if (settings.coco && settings.format != "npz" && settings.format != kWebDataset)
    throw std::runtime_error("--coco: labels are in .npz files: --format npz or webdataset");
  set_up_log(settings.terrain.log_level);
  CampaignOptions options{.folder = settings.output,
                          .format = settings.format,
                          .shard = shard_of(settings.shard),
                          .frames_per_tar = settings.frames_per_tar,
                          .replace = settings.resume,
                          .in_work = settings.in_work};
  if (options.in_work == 0) options.in_work = std::thread::hardware_concurrency() > 1 ? 2 : 1;
  stop_on_signal();
  const Manifest manifest(settings.manifest, settings.limits.max_json_depth);
  const auto renderer = make_renderer(settings.terrain);
  const api::Service service(renderer, settings.limits, settings.terrain.assets_dir, mesh_options(settings.terrain));
  const Run run = run_of(manifest, options, renderer->terrain().catalogue().fingerprint());
  const CampaignTally tally = run_campaign(manifest, service, run, options, stop);
  print_tally(tally, settings.output);
  if (tally.interrupted || tally.failed > 0) return kRunAgain;
  if (settings.coco) write_labels(manifest, options, run);
  return tally.bad > 0 ? kBadLines : kAllDone;
}

int batch_verify(const BatchVerifySettings& settings) {
  set_up_log("info");
  const Manifest manifest(settings.manifest, api::Limits().max_json_depth);
  const CheckResult result = check_campaign(manifest, settings.output);
  for (const FoundFault& fault : result.faults) {
    const std::string what =
        fault.line ? fmt::format("line {} ({})", fault.line->number, fault.line->name) : fault.file;
    fmt::print(stderr, "{}: {}: {}\n", fault_name(fault.fault), what, fault.why);
  }
  if (!settings.rerun.empty()) {
    write_whole(settings.rerun, lines_to_rerun(manifest, result));
    for (const FoundFault& fault : result.faults)
      if (fault.fault == Fault::damaged || fault.fault == Fault::doubled) put_aside(settings.output, fault.file);
  }
  const std::size_t bad = result.count(Fault::bad), extra = result.count(Fault::extra);
  fmt::print(said_beside(settings.rerun),
             "{}: {} frames are there once and whole; {} missing, {} damaged, {} doubled, {} bad, {} extra\n",
             settings.output, result.good, result.count(Fault::missing), result.count(Fault::damaged),
             result.count(Fault::doubled), bad, extra);
  if (result.faults.size() > bad + extra) return kRunAgain;  // no run would remove what is extra
  return bad > 0 ? kBadLines : kAllDone;
}

}  // namespace selenograph::server
