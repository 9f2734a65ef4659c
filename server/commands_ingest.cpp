// `selenograph ingest`: builds the pyramid ahead. What is done stays done, so it can be interrupted and resumed.
#include <fmt/format.h>
#include <unistd.h>

#include <chrono>
#include <csignal>
#include <cstdio>

#include "server/commands.h"
#include "server/start.h"

namespace selenograph::server {
namespace {

volatile std::sig_atomic_t interrupted = 0;

// After the first signal the default is back: a second one quits at once.
void finish_chunk_on_signal() {
  struct sigaction action {};
  action.sa_handler = [](int) { interrupted = 1; };
  action.sa_flags = static_cast<int>(SA_RESETHAND);
  ::sigaction(SIGINT, &action, nullptr);
  ::sigaction(SIGTERM, &action, nullptr);
}

class ProgressBar {
 public:
  void show(std::size_t done, std::size_t total, const std::string& name) {
    const int percent = static_cast<int>(100 * done / total);
    if (!terminal_ && percent < last_percent_ + 5 && done != total) return;
    last_percent_ = percent;
    constexpr int kWidth = 30;
    const std::string bar(static_cast<std::size_t>(kWidth * percent / 100), '#');
    const std::chrono::duration<double> spent = std::chrono::steady_clock::now() - start_;
    const double left_s = spent.count() / static_cast<double>(done) * static_cast<double>(total - done);
    fmt::print(stderr, "{}[{:<{}}] {:3}%  {}/{} chunks  {:.0f} s left  {}{}", terminal_ ? "\r\033[K" : "", bar, kWidth,
               percent, done, total, left_s, name, terminal_ && done != total ? "" : "\n");
  }
  void end_line() const {
    if (terminal_) fmt::print(stderr, "\n");
  }

 private:
  const bool terminal_ = ::isatty(STDERR_FILENO) == 1;
  const std::chrono::steady_clock::time_point start_ = std::chrono::steady_clock::now();
  int last_percent_ = -5;
};

}  // namespace

int ingest(const TerrainSettings& settings) {
  set_up_log(settings.log_level);
  const auto terrain = open_terrain(settings);
  finish_chunk_on_signal();
  ProgressBar bar;
  std::size_t done = 0, total = 0;
  terrain->ingest([&](std::size_t d, std::size_t t, const std::string& name) {
    done = d;
    total = t;
    bar.show(d, t, name);
    return interrupted == 0;
  });
  for (const std::string& warning : terrain->warnings()) fmt::print(stderr, "warning: {}\n", warning);
  if (interrupted && done < total) {
    bar.end_line();
    fmt::print(stderr, "interrupted: {} of {} chunks are done and stay in {}; run the same command to go on\n", done,
               total, settings.cache_dir);
    return 130;
  }
  fmt::print("{}the pyramid in {} is complete\n", terrain->statistics().chunks_built == 0 ? "nothing to do: " : "",
             settings.cache_dir);
  return 0;
}

}  // namespace selenograph::server
