// `selenograph batch` renders a manifest's frames, and `selenograph batch verify` checks that all are there.
#include <fmt/format.h>

#include <atomic>
#include <csignal>
#include <cstdio>
#include <filesystem>
#include <stdexcept>
#include <thread>

#include "api/answers/metadata.h"
#include "api/json/json_reader.h"
#include "api/message/json_text.h"
#include "api/message/version.h"
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

// Exit statuses: all frames are done; some may be done by running the command again; some lines can never be a frame.
constexpr int kAllDone = 0, kRunAgain = 1, kBadLines = 2;

std::atomic<bool> stop{false};
static_assert(std::atomic<bool>::is_always_lock_free);  // a signal handler sets it

// Resets the default action after the first signal, so that a second one ends the process at once.
void stop_on_signal() {
  struct sigaction action {};
  action.sa_handler = [](int) { stop = true; };
  action.sa_flags = static_cast<int>(SA_RESETHAND);
  ::sigaction(SIGINT, &action, nullptr);
  ::sigaction(SIGTERM, &action, nullptr);
}

void require(const std::string& value, const char* what) {
  if (value.empty()) throw std::runtime_error(std::string(what) + " is required; see --help");
}

void print_tally(const CampaignTally& tally, const std::string& folder) {
  fmt::print("{}: {} frames rendered, {} existed\n", folder, tally.rendered, tally.existing);
  if (tally.incomplete > 0)
    fmt::print("{} of the frames have pixels that look at the Moon outside the data: black, NaN or 65535 there\n",
               tally.incomplete);
  for (const auto& [text, frames] : tally.warnings) fmt::print("warning, of {} frames: {}\n", frames, text);
  if (tally.bad > 0) fmt::print("{} lines can never become a frame: see the journal\n", tally.bad);
  if (tally.failed > 0)
    fmt::print("{} lines failed temporarily: see the journal, and run the same command again\n", tally.failed);
  if (tally.interrupted) fmt::print("interrupted: run the same command to continue\n");
}

// Writes the labels of all finished frames, those of earlier runs as well.
void write_labels(const Manifest& manifest, const CampaignOptions& options, const std::string& made_by) {
  std::vector<const ManifestLine*> lines;
  if (options.format == kWebDataset) {
    for (const TarPlan& tar : tars_of(manifest, options.shard, options.frames_per_tar))
      lines.insert(lines.end(), tar.lines.begin(), tar.lines.end());
  } else {
    lines = lines_of(manifest, options.shard);
  }
  const CocoTally tally = write_coco(lines, Record(options.folder, made_by), options.shard, options.folder, stop);
  fmt::print("{}: {} annotations of {} frames\n", tally.path, tally.annotations, tally.images);
  if (tally.without_labels > 0)
    fmt::print("{} frames are left out: their requests have no \"labels\": true, or several cameras\n",
               tally.without_labels);
}

// Returns a line that keeps its name in another manifest, where it has another number.
std::string line_with_name(const Manifest& manifest, const ManifestLine& line) {
  api::Json request = manifest.request(line);
  request["name"] = line.name;
  return api::json_line(request);
}

// Renames a damaged file, so that `batch` can write the frame in its place.
void put_aside(const std::string& folder, const std::string& file) {
  const std::string path = (fs::path(folder) / file).string();
  if (fs::exists(path)) rename_on_disk(path, path + ".damaged");
}

// Writes the manifest of the lines to run again, and renames their damaged files.
void write_rerun(const Manifest& manifest, const CheckResult& result, const BatchVerifySettings& settings) {
  std::string text;
  for (const LineNotDone& finding : result.not_done)
    if (!finding.is_bad) text += line_with_name(manifest, *finding.line);
  write_whole(settings.rerun, text);
  for (const LineNotDone& finding : result.not_done)
    if (!finding.file.empty()) put_aside(settings.output, finding.file);
}

}  // namespace

int batch(const BatchSettings& settings) {
  require(settings.manifest, "MANIFEST.jsonl");
  require(settings.output, "--output DIR");
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
  const Manifest manifest(settings.manifest, api::kMaxJsonDepth);
  const auto renderer = make_renderer(settings.terrain);
  const api::Service service(renderer, settings.limits, settings.terrain.assets_dir, mesh_options(settings.terrain));
  const std::string made_by =
      fmt::format("{} {:016x}", api::software_version(), renderer->terrain().catalogue().fingerprint());
  const CampaignTally tally = run_campaign(manifest, service, made_by, options, stop);
  print_tally(tally, settings.output);
  if (tally.interrupted || tally.failed > 0) return kRunAgain;
  if (settings.coco) write_labels(manifest, options, made_by);
  return tally.bad > 0 ? kBadLines : kAllDone;
}

int batch_verify(const BatchVerifySettings& settings) {
  set_up_log("info");
  const Manifest manifest(settings.manifest, api::kMaxJsonDepth);
  const CheckResult result = check_campaign(manifest, settings.output);
  std::size_t bad = 0;
  for (const LineNotDone& finding : result.not_done) {
    fmt::print(stderr, "{}: line {} ({}): {}\n", finding.is_bad ? "bad" : "not done", finding.line->number,
               finding.line->name, finding.why);
    if (finding.is_bad) ++bad;  // a bad line can never be a frame: it is not counted as open work
  }
  if (!settings.rerun.empty()) write_rerun(manifest, result, settings);
  const std::size_t not_done = result.not_done.size() - bad;
  fmt::print(stream_for_messages(settings.rerun), "{}: {} frames done, {} not done, {} bad lines\n", settings.output,
             result.done, not_done, bad);
  if (not_done > 0) return kRunAgain;
  return bad > 0 ? kBadLines : kAllDone;
}

}  // namespace selenograph::server
