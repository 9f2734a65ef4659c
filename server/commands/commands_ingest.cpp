// `selenograph ingest`: builds the terrain pyramid in advance. Finished chunks stay on disk, so that it can be
// interrupted and resumed.
#include <fmt/format.h>

#include <csignal>
#include <cstdio>
#include <stdexcept>

#include "server/commands/commands.h"
#include "server/commands/output.h"
#include "server/commands/start.h"

namespace selenograph::server {
namespace {

volatile std::sig_atomic_t interrupted = 0;

// Resets the default action after the first signal, so that a second one ends the process at once.
void finish_chunk_on_signal() {
  struct sigaction action {};
  action.sa_handler = [](int) { interrupted = 1; };
  action.sa_flags = static_cast<int>(SA_RESETHAND);
  ::sigaction(SIGINT, &action, nullptr);
  ::sigaction(SIGTERM, &action, nullptr);
}

}  // namespace

int ingest(const TerrainSettings& settings) {
  set_up_log(settings.log_level);
  if (settings.cache_dir.empty()) throw std::runtime_error("--cache-dir DIR is required: it holds the pyramid");
  const auto terrain = open_terrain(settings);
  finish_chunk_on_signal();
  ProgressBar bar;
  std::size_t done = 0, total = 0;
  terrain->ingest([&](std::size_t d, std::size_t t, const std::string& name) {
    done = d;
    total = t;
    bar.show(static_cast<double>(d) / static_cast<double>(t), fmt::format("{}/{} chunks  {}", d, t, name));
    return interrupted == 0;
  });
  for (const std::string& warning : terrain->warnings()) fmt::print(stderr, "warning: {}\n", warning);
  if (interrupted && done < total) {
    bar.end_line();
    fmt::print(stderr, "interrupted: {} of {} chunks are in {}; run the same command to continue\n", done, total,
               settings.cache_dir);
    return 130;
  }
  fmt::print("{}the pyramid in {} is complete\n", terrain->statistics().chunks_built == 0 ? "nothing to do: " : "",
             settings.cache_dir);
  return 0;
}

}  // namespace selenograph::server
