#include "server/campaign/campaign.h"

#include <fmt/format.h>
#include <spdlog/spdlog.h>

#include <algorithm>
#include <chrono>
#include <condition_variable>
#include <exception>
#include <filesystem>
#include <mutex>
#include <optional>
#include <set>
#include <stdexcept>
#include <thread>
#include <vector>

#include "dem/files/whole_file.h"
#include "server/campaign/frame_file.h"
#include "server/campaign/frame_source.h"
#include "server/campaign/progress.h"
#include "server/campaign/tar.h"

namespace selenograph::server {
namespace {

namespace fs = std::filesystem;

// Lets threads that work in parallel hand over their results in order: each waits for the turn of its number, and
// calls done().
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

// A tar and the lines whose frames it holds.
struct TarPlan {
  std::string path;
  Span lines;
};

// State of a file under a line's name.
enum class Existing { done, missing, failed, foreign, unknown };

class Campaign {
 public:
  Campaign(const Manifest& manifest, const api::Service& service, const CampaignOptions& options,
           std::atomic<bool>& stop)
      : manifest_(manifest),
        options_(options),
        stop_(stop),
        suffix_("." + (options.format == kWebDataset ? "npz" : options.format)),
        frames_(manifest, service, suffix_.substr(1), stop) {}

  CampaignTally run() {
    const std::size_t lines = options_.format == kWebDataset ? write_tars() : write_files();
    tally_.interrupted = tally_.rendered + tally_.existing + tally_.bad + tally_.failed + tally_.left_out < lines;
    return tally_;
  }

 private:
  const ManifestLine& line(std::size_t i) const { return manifest_.lines()[i]; }
  std::string path_of(const ManifestLine& line) const { return in_folder(options_.folder, line.name + suffix_); }

  // Calls work(i) for all i of the span on in_work threads. The first exception stops the others and is rethrown.
  template <typename Work>
  void in_parallel(const Span& span, const Work& work) {
    std::atomic<std::size_t> next{span.begin};
    std::mutex mutex;
    std::exception_ptr first;
    const auto worker = [&] {
      try {
        for (std::size_t i = 0; !stop_ && (i = next++) < span.end;) work(i);
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

  // Removes what killed processes have left of these files.
  void remove_unfinished(const std::set<std::string>& paths) const {
    for (const fs::directory_entry& entry : fs::directory_iterator(options_.folder)) {
      const std::string path = entry.path().string();
      const std::size_t mark = path.rfind(dem::kTemporaryMark);
      if (mark != std::string::npos && paths.contains(path.substr(0, mark))) fs::remove(entry.path());
    }
  }

  Answer render(const ManifestLine& line) const {
    return line.problem ? Answer{Outcome::refused, {}} : frames_.render(line);
  }

  // Logs and counts a line without a frame, and records the problem of one that was refused.
  void note_problem(const ManifestLine& line, const Answer& answer) {
    const Problem problem = line.problem ? *line.problem : problem_of(answer.response.body, answer.response.status);
    if (!line.problem && answer.outcome == Outcome::refused) record_problem(options_.folder, manifest_, line, problem);
    std::string text = problem.value("detail", std::string("no answer"));
    if (const auto errors = problem.find("errors"); errors != problem.end() && errors->size() > 1)
      for (const auto& error : *errors)
        text += fmt::format("\n  {}: {}", error.value("pointer", ""), error.value("detail", ""));
    spdlog::warn("{}, line {} ({}): {}", manifest_.path(), line.number, line.name, text);
    const std::lock_guard lock(mutex_);
    std::size_t& tally = answer.outcome == Outcome::failed ? tally_.failed : tally_.bad;
    ++tally;
  }

  // Counts a rendered frame and its warnings.
  void count(const Answer& answer, CampaignTally& tally) {
    const api::Json warnings = api::Json::parse(answer.header("Selenograph-Warnings"), nullptr, false);
    const std::lock_guard lock(mutex_);
    ++tally.rendered;
    if (!answer.header("Selenograph-Missing-Fraction").empty()) ++tally.incomplete;
    if (warnings.is_array())
      for (const api::Json& text : warnings) ++tally.warnings[text.get<std::string>()];
  }

  // Compares a stored frame with the one that the line would give now.
  Existing compare(const ManifestLine& line, const FrameFile& frame) {
    const Answer answer = frames_.identify(line);
    if (answer.outcome == Outcome::cancelled) return Existing::unknown;
    if (answer.outcome == Outcome::failed) {
      note_problem(line, answer);
      return Existing::failed;
    }
    const std::string tag = answer.header("ETag");
    if (answer.outcome != Outcome::not_modified || tag.size() < 2) return Existing::foreign;
    try {
      return has_content_hash(frame, tag.substr(1, tag.size() - 2)) ? Existing::done : Existing::foreign;
    } catch (const std::runtime_error&) {
      return Existing::foreign;  // it cannot be read
    }
  }

  void refuse_unless_replaced(const std::string& path, const std::string& lines) const {
    if (options_.replace) return;
    throw std::runtime_error(
        fmt::format("{}: exists, but is not what {} of {} gives with this software and this terrain; --resume replaces "
                    "such files, and batch verify finds damaged ones",
                    path, lines, manifest_.path()));
  }

  // Returns the states of the lines' frames that `find` returns (null: Existing::missing), and counts the finished
  // ones.
  template <typename Find>
  std::vector<Existing> compare_all(const Span& lines, const Find& find) {
    std::vector<Existing> states(lines.size(), Existing::unknown);
    in_parallel(lines, [&](std::size_t i) {
      const std::optional<FrameFile> frame = line(i).problem ? std::nullopt : find(line(i));
      states[i - lines.begin] = frame ? compare(line(i), *frame) : Existing::missing;
    });
    tally_.existing += number_of(Existing::done, states);
    return states;
  }

  static std::size_t number_of(Existing state, const std::vector<Existing>& states) {
    return static_cast<std::size_t>(std::count(states.begin(), states.end(), state));
  }

  // Returns the numbers of the lines without a finished file.
  std::vector<std::size_t> missing_files(const Span& lines) {
    const std::vector<Existing> states = compare_all(lines, [&](const ManifestLine& line) {
      std::error_code missing;
      const std::string path = path_of(line);
      const auto bytes = fs::file_size(path, missing);
      return missing ? std::nullopt : std::optional(FrameFile{path, 0, bytes});
    });
    std::vector<std::size_t> missing;
    for (std::size_t i = lines.begin; i < lines.end; ++i) {
      const Existing state = states[i - lines.begin];
      if (state == Existing::foreign) refuse_unless_replaced(path_of(line(i)), fmt::format("line {}", line(i).number));
      if (state == Existing::foreign || state == Existing::missing) missing.push_back(i);
    }
    return missing;
  }

  // Both write functions return the number of the shard's lines.
  std::size_t write_files() {
    const Span lines = span_of(manifest_.lines().size(), options_.shard);
    std::set<std::string> paths;
    for (std::size_t i = lines.begin; i < lines.end; ++i)
      paths.insert({path_of(line(i)), problem_path(options_.folder, line(i))});
    remove_unfinished(paths);
    const std::vector<std::size_t> missing = missing_files(lines);
    CampaignProgress progress(missing.size());
    in_parallel({0, missing.size()}, [&](std::size_t i) {
      const ManifestLine& next = line(missing[i]);
      const Answer answer = render(next);
      if (answer.outcome == Outcome::cancelled) return;
      if (answer.outcome == Outcome::frame) {
        dem::write_whole_file(path_of(next), answer.response.body);
        fs::remove(problem_path(options_.folder, next));
        count(answer, tally_);
      } else {
        note_problem(next, answer);
        // Remove the frame of another request, which `replace` gives up.
        if (!next.problem && answer.outcome == Outcome::refused) fs::remove(path_of(next));
      }
      progress.step(next.name);
    });
    return lines.size();
  }

  // The tars are cut first and then distributed, so that they do not depend on the number of shards.
  std::vector<TarPlan> plan_tars() const {
    const std::size_t lines = manifest_.lines().size(), per_tar = options_.frames_per_tar;
    const Span tars = span_of((lines + per_tar - 1) / per_tar, options_.shard);
    std::vector<TarPlan> plans;
    for (std::size_t i = tars.begin; i < tars.end; ++i)
      plans.push_back({in_folder(options_.folder, fmt::format("frames-{:06}.tar", i)),
                       {i * per_tar, std::min((i + 1) * per_tar, lines)}});
    return plans;
  }

  // Returns a tar's frames by the names of their members; none if it cannot be read.
  static std::map<std::string, FrameFile> members_of(const std::string& path) {
    std::map<std::string, FrameFile> members;
    try {
      for (const TarMember& member : list_tar(path)) members[member.name] = {path, member.offset, member.bytes};
    } catch (const std::runtime_error&) {
      members.clear();
    }
    return members;
  }

  // Returns true if the tar is finished or cannot be judged now; counts its lines then.
  bool has_tar(const TarPlan& plan) {
    if (!fs::exists(plan.path)) return false;
    const std::map<std::string, FrameFile> members = members_of(plan.path);
    const std::vector<Existing> states = compare_all(plan.lines, [&](const ManifestLine& line) {
      const auto member = members.find(line.name + suffix_);
      return member == members.end() ? std::nullopt : std::optional(member->second);
    });
    bool is_foreign = number_of(Existing::foreign, states) > 0;
    std::size_t bad = 0;
    for (std::size_t i = plan.lines.begin; i < plan.lines.end; ++i) {
      if (states[i - plan.lines.begin] != Existing::missing) continue;
      ++bad;
      is_foreign |= !line(i).problem && !recorded_problem(options_.folder, manifest_, line(i));
    }
    // Refuse a tar that holds the frames of other lines, too.
    is_foreign |= members.size() + bad > plan.lines.size();
    if (is_foreign) {
      tally_.existing -= number_of(Existing::done, states);
      refuse_unless_replaced(
          plan.path, fmt::format("lines {} to {}", line(plan.lines.begin).number, line(plan.lines.end - 1).number));
      return false;
    }
    tally_.bad += bad;
    return true;
  }

  std::size_t write_tars() {
    const std::vector<TarPlan> plans = plan_tars();
    std::set<std::string> paths;
    for (const TarPlan& plan : plans) paths.insert(plan.path);
    remove_unfinished(paths);
    std::vector<TarPlan> missing;
    std::size_t lines = 0, missing_lines = 0;
    for (const TarPlan& plan : plans) {
      lines += plan.lines.size();
      if (stop_ || has_tar(plan)) continue;
      missing.push_back(plan);
      missing_lines += plan.lines.size();
    }
    CampaignProgress progress(missing_lines);
    for (const TarPlan& plan : missing)
      if (!stop_) write(plan, progress);
    return lines;
  }

  // Renders a tar's frames in parallel, and appends them in the manifest's order. After a line that failed the others
  // are left out: a tar is written whole, by the next run.
  void write(const TarPlan& plan, CampaignProgress& progress) {
    dem::WholeFile tar(plan.path);
    InTurn turn(stop_);
    CampaignTally stored;
    std::atomic<bool> has_failed = false;
    std::size_t left_out = 0;  // each thread changes it only in its turn
    in_parallel({0, plan.lines.size()}, [&](std::size_t i) {
      const ManifestLine& next = line(plan.lines.begin + i);
      const Answer answer = has_failed ? Answer{} : render(next);
      if ((answer.outcome == Outcome::cancelled && !has_failed) || !turn.wait(i)) return;
      if (answer.outcome == Outcome::refused || answer.outcome == Outcome::failed) {
        note_problem(next, answer);
        has_failed = has_failed || answer.outcome == Outcome::failed;
      } else if (has_failed) {
        ++left_out;
      } else {
        tar.write(tar_member(next.name + suffix_, answer.response.body));
        fs::remove(problem_path(options_.folder, next));
        count(answer, stored);
      }
      progress.step(next.name);
      turn.done();
    });
    if (turn.count() < plan.lines.size()) return;
    if (has_failed) {
      tally_.left_out += left_out + stored.rendered;
      return;
    }
    if (stored.rendered > 0) {
      tar.write(tar_end());
      tar.finish();
    } else {
      fs::remove(plan.path);  // a tar of other requests, which `replace` gives up
    }
    tally_.rendered += stored.rendered;
    tally_.incomplete += stored.incomplete;
    for (const auto& [text, frames] : stored.warnings) tally_.warnings[text] += frames;
  }

  const Manifest& manifest_;
  const CampaignOptions& options_;
  std::atomic<bool>& stop_;
  const std::string suffix_;
  const FrameSource frames_;
  std::mutex mutex_;
  CampaignTally tally_;
};

}  // namespace

CampaignTally run_campaign(const Manifest& manifest, const api::Service& service, const CampaignOptions& options,
                           std::atomic<bool>& stop) {
  fs::create_directories(options.folder);
  return Campaign(manifest, service, options, stop).run();
}

}  // namespace selenograph::server
