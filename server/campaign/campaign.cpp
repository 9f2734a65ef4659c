#include "server/campaign/campaign.h"

#include <fmt/format.h>
#include <spdlog/spdlog.h>

#include <chrono>
#include <condition_variable>
#include <cstdlib>
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

struct Answer {
  Outcome outcome = Outcome::cancelled;
  api::Response response;
  double ms = 0;
};

std::string header_of(const api::Response& response, std::string_view name) {
  for (const auto& [known, value] : response.headers)
    if (known == name) return value;
  return {};
}

RenderedFrame frame_of(const Answer& answer) {
  RenderedFrame frame{.bytes = answer.response.body, .content_hash = {}, .ms = answer.ms, .missing_fraction = {}};
  if (const std::string tag = header_of(answer.response, "ETag"); tag.size() > 2)
    frame.content_hash = tag.substr(1, tag.size() - 2);
  if (const std::string share = header_of(answer.response, "Selenograph-Missing-Fraction"); !share.empty())
    frame.missing_fraction = std::strtod(share.c_str(), nullptr);
  return frame;
}

// Requests one by one, as POST /v1/frames answers them.
class Frames {
 public:
  Frames(const Manifest& manifest, const api::Service& service, std::string_view media_type, std::atomic<bool>& stop)
      : manifest_(manifest), service_(service), media_type_(media_type), stop_(stop) {}

  Answer render(const ManifestLine& line) const {
    constexpr int kTries = 3;
    api::Request request;
    request.method = "POST";
    request.path = "/v1/frames";
    request.headers = {{"accept", media_type_}, {"content-type", "application/json"}};
    request.body = api::json_text(manifest_.request(line));
    request.abandoned = &stop_;
    Answer answer;
    for (int i = 0; i < kTries && !stop_; ++i) {
      request.received = Clock::now();
      answer.response = service_.handle(request);
      answer.ms = std::chrono::duration<double, std::milli>(Clock::now() - request.received).count();
      answer.outcome = outcome_of(answer.response.status);
      // 503: others may have what is needed.
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

// Things done in several threads, taken over in their order.
class InTurn {
 public:
  explicit InTurn(std::atomic<bool>& stop) : stop_(stop) {}

  // Waits until all before `number` have had their turn. False: the work is stopped.
  bool wait(std::size_t number) {
    std::unique_lock lock(mutex_);
    while (next_ != number && !stop_) changed_.wait_for(lock, std::chrono::milliseconds(20));
    return next_ == number;
  }
  void done() {
    const std::lock_guard lock(mutex_);
    ++next_;
    changed_.notify_all();
  }
  // How many have had it.
  std::size_t count() const { return next_; }

 private:
  std::atomic<bool>& stop_;
  std::mutex mutex_;
  std::condition_variable changed_;
  std::size_t next_ = 0;
};

class Campaign {
 public:
  Campaign(const Manifest& manifest, const api::Service& service, const Run& run, const CampaignOptions& options,
           std::atomic<bool>& stop)
      : manifest_(manifest),
        options_(options),
        stop_(stop),
        journal_(options.folder, run),
        record_(options.folder, &run),
        frames_(manifest, service, media_type(options.format), stop) {
    if (!record_.format().empty() && record_.format() != options.format)
      throw std::runtime_error(fmt::format("{}: holds a campaign's frames as {}: give {} a folder of its own",
                                           options.folder, record_.format(), options.format));
  }

  CampaignTally run() {
    const std::size_t lines = options_.format == kWebDataset ? write_tars() : write_files();
    tally_.interrupted = tally_.rendered + tally_.kept + tally_.bad + tally_.failed < lines;
    return tally_;
  }

 private:
  static std::string_view media_type(const std::string& format) {
    for (const api::Representation& r : api::representations())
      if (r.extension == (format == kWebDataset ? "npz" : format)) return r.media_type;
    throw std::runtime_error(format + ": there is no such format");
  }

  // Does work(i) for 0 <= i < count, several at a time; the first thing thrown ends all.
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

  // What is no frame.
  void note(const ManifestLine& line, const Answer& answer) {
    const Problem problem = line.problem ? *line.problem : problem_of(answer.response.body, answer.response.status);
    const LineWithoutFrame* known = record_.without_frame(line);
    if (!known || known->problem != problem)
      journal_.add(LineWithoutFrame{line.name, line.number, line.request_sha256, problem});
    std::string said = problem.value("detail", std::string("no answer"));
    if (const auto errors = problem.find("errors"); errors != problem.end() && errors->size() > 1)
      for (const auto& error : *errors)
        said += fmt::format("\n  {}: {}", error.value("pointer", ""), error.value("detail", ""));
    spdlog::warn("{}, line {} ({}): {}", manifest_.path(), line.number, line.name, said);
    const std::lock_guard lock(mutex_);
    answer.outcome == Outcome::failed ? ++tally_.failed : ++tally_.bad;
  }

  Answer answer_to(const ManifestLine& line) const {
    return line.problem ? Answer{Outcome::bad, {}, 0} : frames_.render(line);
  }

  void count(const RenderedFrame& frame, const Answer& answer) {
    const api::Json warnings = api::Json::parse(header_of(answer.response, "Selenograph-Warnings"), nullptr, false);
    const std::lock_guard lock(mutex_);
    ++tally_.rendered;
    tally_.outside += frame.missing_fraction.has_value();
    if (warnings.is_array())
      for (const api::Json& text : warnings) ++tally_.warnings[text.get<std::string>()];
  }

  // Both answer how many lines there are.
  std::size_t write_files() {
    FrameFolder folder(options_.folder, options_.format, options_.shard, record_, journal_);
    const std::vector<const ManifestLine*> lines = lines_of(manifest_, options_.shard);
    std::vector<const ManifestLine*> missing;
    for (const ManifestLine* line : lines) {
      if (!line->problem && folder.has(*line)) {
        ++tally_.kept;
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
      if (answer.outcome != Outcome::frame) return note(line, answer), progress.step(line.name);
      const RenderedFrame frame = frame_of(answer);
      folder.put(line, frame);
      count(frame, answer);
      progress.step(line.name);
    });
    return lines.size();
  }

  // A tar that was finished earlier.
  void keep(const TarPlan& tar) {
    for (const ManifestLine* line : tar.lines)
      line->problem || record_.without_frame(*line) ? ++tally_.bad : ++tally_.kept;
  }

  std::size_t write_tars() {
    const std::vector<TarPlan> all = tars_of(manifest_, options_.shard, options_.frames_per_tar);
    std::vector<const TarPlan*> tars;
    std::size_t lines = 0, missing = 0;
    for (const TarPlan& tar : all) {
      lines += tar.lines.size();
      if (TarWriter::has(options_.folder, tar, record_)) {
        keep(tar);
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

  void write(const TarPlan& plan, CampaignProgress& progress) {
    TarWriter tar(options_.folder, "npz", plan, journal_);
    InTurn turn(stop_);
    bool whole = true;
    in_parallel(plan.lines.size(), [&](std::size_t i) {
      const ManifestLine& line = *plan.lines[i];
      const Answer answer = answer_to(line);
      if (answer.outcome == Outcome::cancelled || !turn.wait(i)) return;
      if (answer.outcome != Outcome::frame) {
        note(line, answer);
        whole &= answer.outcome == Outcome::bad;
      } else if (whole) {
        // Behind a frame that is missing none can be put; the rest is tried all the same, so that its problems are
        // known.
        const RenderedFrame frame = frame_of(answer);
        tar.put(line, frame);
        count(frame, answer);
      }
      progress.step(line.name);
      turn.done();
    });
    if (whole && turn.count() == plan.lines.size()) tar.finish();
  }

  const Manifest& manifest_;
  const CampaignOptions& options_;
  std::atomic<bool>& stop_;
  Journal journal_;  // first: nobody else works at this shard while the record is read
  const Record record_;
  const Frames frames_;
  std::mutex mutex_;
  CampaignTally tally_;
};

}  // namespace

CampaignTally run_campaign(const Manifest& manifest, const api::Service& service, const Run& run,
                           const CampaignOptions& options, std::atomic<bool>& stop) {
  fs::create_directories(options.folder);
  return Campaign(manifest, service, run, options, stop).run();
}

}  // namespace selenograph::server
