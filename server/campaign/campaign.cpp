#include "server/campaign/campaign.h"

#include <fmt/format.h>
#include <spdlog/spdlog.h>

#include <chrono>
#include <condition_variable>
#include <exception>
#include <filesystem>
#include <mutex>
#include <stdexcept>
#include <thread>
#include <vector>

#include "api/encode/negotiate.h"
#include "api/message/json_text.h"
#include "server/campaign/progress.h"
#include "server/campaign/store.h"

namespace selenograph::server {
namespace {

namespace fs = std::filesystem;
using Clock = std::chrono::steady_clock;

enum class Outcome { frame, bad, failed, cancelled };

// Answer to one line, and its rendering time.
struct Answer {
  Outcome outcome = Outcome::cancelled;
  api::Response response;
  double ms = 0;
};

std::string header_of(const api::Response& response, std::string_view name) {
  for (const auto& [header, value] : response.headers)
    if (header == name) return value;
  return {};
}

// Returns the answer's frame, which points to the answer's bytes.
RenderedFrame frame_of(const Answer& answer) {
  RenderedFrame frame{.bytes = answer.response.body, .content_hash = {}, .ms = answer.ms};
  if (const std::string tag = header_of(answer.response, "ETag"); tag.size() > 2)
    frame.content_hash = tag.substr(1, tag.size() - 2);  // without its quotation marks
  frame.is_incomplete = !header_of(answer.response, "Selenograph-Missing-Fraction").empty();
  return frame;
}

// Renders lines as POST /v1/frames answers them.
class FrameSource {
 public:
  FrameSource(const Manifest& manifest, const api::Service& service, std::string_view media_type,
              std::atomic<bool>& stop)
      : manifest_(manifest), service_(service), media_type_(media_type), stop_(stop) {}

  Answer render(const ManifestLine& line) const {
    constexpr int kMaxTries = 3;
    api::Request request;
    request.method = "POST";
    request.path = "/v1/frames";
    request.headers = {{"accept", media_type_}, {"content-type", "application/json"}};
    request.body = api::json_text(manifest_.request(line));
    request.abandoned = &stop_;
    Answer answer;
    for (int i = 0; i < kMaxTries && !stop_; ++i) {
      request.received = Clock::now();
      answer.response = service_.handle(request);
      answer.ms = std::chrono::duration<double, std::milli>(Clock::now() - request.received).count();
      answer.outcome = outcome_of(answer.response.status);
      // 503: other requests hold the memory that this one needs. Try again after a second, which `stop_` cuts short.
      if (answer.response.status != 503) return answer;
      for (int wait = 0; wait < 20 && !stop_; ++wait) std::this_thread::sleep_for(std::chrono::milliseconds(50));
    }
    if (stop_) answer.outcome = Outcome::cancelled;
    return answer;
  }

 private:
  Outcome outcome_of(int status) const {
    if (status == 200) return Outcome::frame;
    if (stop_) return Outcome::cancelled;
    return status < 500 ? Outcome::bad : Outcome::failed;
  }

  const Manifest& manifest_;
  const api::Service& service_;
  const std::string media_type_;
  std::atomic<bool>& stop_;
};

// Lets threads that work in parallel hand over their results in order: thread by thread, each waits for the number of
// its result, hands it over and calls done().
class InTurn {
 public:
  explicit InTurn(std::atomic<bool>& stop) : stop_(stop) {}

  // Waits until all turns before `number` are done. Returns false if the work is stopped.
  bool wait(std::size_t number) {
    std::unique_lock lock(mutex_);
    // Wake up regularly: setting `stop_` notifies no condition variable.
    while (next_ != number && !stop_) changed_.wait_for(lock, std::chrono::milliseconds(20));
    return next_ == number;
  }
  void done() {
    const std::lock_guard lock(mutex_);
    ++next_;
    changed_.notify_all();
  }
  // Number of turns that are done. Call it when no thread waits.
  std::size_t count() const { return next_; }

 private:
  std::atomic<bool>& stop_;
  std::mutex mutex_;
  std::condition_variable changed_;
  std::size_t next_ = 0;
};

class Campaign {
 public:
  Campaign(const Manifest& manifest, const api::Service& service, const std::string& made_by,
           const CampaignOptions& options, std::atomic<bool>& stop)
      : manifest_(manifest),
        options_(options),
        stop_(stop),
        journal_(options.folder, options.shard, made_by),
        record_(options.folder, made_by),
        frames_(manifest, service, media_type(options.format), stop) {
    const std::string suffix = options.format == kWebDataset ? ".tar" : "." + options.format;
    if (const std::string& file = record_.any_file(); !file.empty() && !file.ends_with(suffix))
      throw std::runtime_error(
          fmt::format("{}: holds a campaign's frames in another format ({}): give {} a folder of "
                      "its own",
                      options.folder, file, options.format));
  }

  CampaignTally run() {
    const std::size_t lines = options_.format == kWebDataset ? write_tars() : write_files();
    tally_.interrupted = tally_.rendered + tally_.existing + tally_.bad + tally_.failed < lines;
    return tally_;
  }

 private:
  static std::string_view media_type(const std::string& format) {
    for (const api::Representation& r : api::representations())
      if (r.extension == (format == kWebDataset ? "npz" : format)) return r.media_type;
    throw std::runtime_error(format + ": is not a format of frames");
  }

  // Calls work(i) for 0 <= i < count on in_work threads. The first exception stops the others and is rethrown.
  template <typename Work>
  void in_parallel(std::size_t count, const Work& work) {
    std::atomic<std::size_t> next{0};
    std::mutex mutex;
    std::exception_ptr first;
    const auto worker = [&] {
      try {
        for (std::size_t i = 0; !stop_ && (i = next++) < count;) work(i);
      } catch (...) {
        const std::lock_guard lock(mutex);
        if (!first) first = std::current_exception();
        stop_ = true;
      }
    };
    std::vector<std::thread> threads;
    for (int i = 1; i < options_.in_work; ++i) threads.emplace_back(worker);
    worker();
    for (std::thread& thread : threads) thread.join();
    if (first) std::rethrow_exception(first);
  }

  // Journals, logs and counts a line without a frame.
  void note_problem(const ManifestLine& line, const Answer& answer) {
    const Problem problem = line.problem ? *line.problem : problem_of(answer.response.body, answer.response.status);
    // Journal a problem once: a repeated run finds the same one.
    const LineWithoutFrame* recorded = record_.without_frame(line);
    if (!recorded || recorded->problem != problem)
      journal_.add(LineWithoutFrame{line.name, line.number, line.request_sha256, problem, {}, {}});
    std::string text = problem.value("detail", std::string("no answer"));
    if (const auto errors = problem.find("errors"); errors != problem.end() && errors->size() > 1)
      for (const auto& error : *errors)
        text += fmt::format("\n  {}: {}", error.value("pointer", ""), error.value("detail", ""));
    spdlog::warn("{}, line {} ({}): {}", manifest_.path(), line.number, line.name, text);
    const std::lock_guard lock(mutex_);
    std::size_t& tally = answer.outcome == Outcome::failed ? tally_.failed : tally_.bad;
    ++tally;
  }

  // Renders a line; one with a problem in the manifest is bad without a request.
  Answer answer_to(const ManifestLine& line) const {
    return line.problem ? Answer{Outcome::bad, {}, 0} : frames_.render(line);
  }

  // Counts a frame and its warnings.
  void count(const RenderedFrame& frame, const Answer& answer) {
    const api::Json warnings = api::Json::parse(header_of(answer.response, "Selenograph-Warnings"), nullptr, false);
    const std::lock_guard lock(mutex_);
    ++tally_.rendered;
    if (frame.is_incomplete) ++tally_.incomplete;
    if (warnings.is_array())
      for (const api::Json& text : warnings) ++tally_.warnings[text.get<std::string>()];
  }

  // Both write functions return the number of the shard's lines.
  std::size_t write_files() {
    FrameFolder folder(options_.folder, options_.format, options_.shard, record_, journal_);
    const std::vector<const ManifestLine*> lines = lines_of(manifest_, options_.shard);
    std::vector<const ManifestLine*> missing;
    for (const ManifestLine* line : lines) {
      if (!line->problem && folder.has(*line)) {
        ++tally_.existing;
        continue;
      }
      if (!line->problem && !options_.replace && folder.is_taken(*line))
        throw std::runtime_error(
            fmt::format("{}: exists, but no journal says that it is the frame of line {} of {} with this software and "
                        "this terrain; --resume replaces such frames",
                        folder.path_of(*line), line->number, manifest_.path()));
      missing.push_back(line);
    }
    CampaignProgress progress(missing.size());
    in_parallel(missing.size(), [&](std::size_t i) {
      const ManifestLine& line = *missing[i];
      const Answer answer = answer_to(line);
      if (answer.outcome == Outcome::cancelled) return;
      if (answer.outcome == Outcome::frame) {
        const RenderedFrame frame = frame_of(answer);
        folder.put(line, frame);
        count(frame, answer);
      } else {
        note_problem(line, answer);
      }
      progress.step(line.name);
    });
    return lines.size();
  }

  // Counts the lines of a tar that was finished earlier.
  void count_existing(const TarPlan& tar) {
    for (const ManifestLine* line : tar.lines) {
      const bool is_bad = line->problem || record_.without_frame(*line);
      std::size_t& tally = is_bad ? tally_.bad : tally_.existing;
      ++tally;
    }
  }

  std::size_t write_tars() {
    const std::vector<TarPlan> plans = tars_of(manifest_, options_.shard, options_.frames_per_tar);
    std::vector<const TarPlan*> tars;
    std::size_t lines = 0, missing = 0;
    for (const TarPlan& tar : plans) {
      lines += tar.lines.size();
      if (TarWriter::has(options_.folder, tar, record_)) {
        count_existing(tar);
      } else {
        tars.push_back(&tar);
        missing += tar.lines.size();
      }
    }
    CampaignProgress progress(missing);
    for (const TarPlan* tar : tars)
      if (!stop_) write(*tar, progress);
    return lines;
  }

  // Renders a tar's frames in parallel, and appends them in the plan's order.
  void write(const TarPlan& plan, CampaignProgress& progress) {
    TarWriter tar(options_.folder, "npz", plan, journal_);
    InTurn turn(stop_);
    bool is_complete = true;  // no frame has failed; each thread changes it only in its turn
    in_parallel(plan.lines.size(), [&](std::size_t i) {
      const ManifestLine& line = *plan.lines[i];
      const Answer answer = answer_to(line);
      if (answer.outcome == Outcome::cancelled || !turn.wait(i)) return;
      if (answer.outcome != Outcome::frame) {
        note_problem(line, answer);
        is_complete &= answer.outcome == Outcome::bad;
      } else if (is_complete) {
        // A tar is in the plan's order, so frames behind a failed one are not put. They are rendered all the same, so
        // that the journal has their problems.
        const RenderedFrame frame = frame_of(answer);
        tar.put(line, frame);
        count(frame, answer);
      }
      progress.step(line.name);
      turn.done();
    });
    if (is_complete && turn.count() == plan.lines.size()) tar.finish();
  }

  const Manifest& manifest_;
  const CampaignOptions& options_;
  std::atomic<bool>& stop_;
  Journal journal_;  // before record_: its lock keeps other processes from this shard while the record is read
  const Record record_;
  const FrameSource frames_;
  std::mutex mutex_;
  CampaignTally tally_;
};

}  // namespace

CampaignTally run_campaign(const Manifest& manifest, const api::Service& service, const std::string& made_by,
                           const CampaignOptions& options, std::atomic<bool>& stop) {
  fs::create_directories(options.folder);
  return Campaign(manifest, service, made_by, options, stop).run();
}

}  // namespace selenograph::server
