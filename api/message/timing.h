// Durations of an answer's stages: the header Server-Timing (https://www.w3.org/TR/server-timing/).
#pragma once

#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace selenograph::api {

using Durations = std::vector<std::pair<std::string, double>>;  // name and milliseconds

// Parts of stages, and the system's time meanwhile. All other durations are disjoint stages.
inline constexpr std::string_view kPartsOfStages[] = {"pyramid", "load", "draw", "resolve", "shadow", "touch"};

inline std::string timing_text(const Durations& durations) {
  std::string text;
  for (const auto& [name, ms] : durations) text += fmt::format("{}{};dur={:.3f}", text.empty() ? "" : ", ", name, ms);
  return text;
}

// `text`: as timing_text() writes it.
inline Durations read_timing(std::string_view text) {
  Durations durations;
  while (!text.empty()) {
    const std::string_view entry = text.substr(0, text.find(','));
    text.remove_prefix(std::min(entry.size() + 1, text.size()));
    const std::size_t start = entry.find_first_not_of(' '), end = entry.find(";dur=");
    if (end == std::string_view::npos || start >= end) continue;
    double ms = 0;
    std::from_chars(entry.data() + end + 5, entry.data() + entry.size(), ms);
    durations.emplace_back(entry.substr(start, end - start), ms);
  }
  return durations;
}

// Adds the time that no stage has, and the total.
inline void complete_timing(Durations& durations, double total_ms) {
  double stages_ms = 0;
  for (const auto& [name, ms] : durations)
    if (std::ranges::find(kPartsOfStages, name) == std::end(kPartsOfStages)) stages_ms += ms;
  durations.emplace_back("other", std::max(total_ms - stages_ms, 0.0));
  durations.emplace_back("total", total_ms);
}

}  // namespace selenograph::api
