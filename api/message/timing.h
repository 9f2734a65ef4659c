// The header Server-Timing (https://www.w3.org/TR/server-timing/).
#pragma once

#include <fmt/format.h>

#include <algorithm>
#include <string>
#include <string_view>

#include "api/message/message.h"

namespace selenograph::api {

// Durations that overlap with others: parts of stages, and "touch", the system's time for touching new memory. All
// other durations are disjoint stages.
inline constexpr std::string_view kOverlappingDurations[] = {
    "pyramid", "load", "relief", "views", "sunlit", "bounces", "gather", "draw", "resolve", "shadow", "touch"};

// Returns the header's value: "queue;dur=0.1, parse;dur=2.3".
inline std::string timing_text(const StageTimes& stages) {
  std::string text;
  for (const auto& [name, ms] : stages) text += fmt::format("{}{};dur={:.3f}", text.empty() ? "" : ", ", name, ms);
  return text;
}

// Adds "other", the time that is in no stage, and "total".
inline void complete_timing(StageTimes& stages, double total_ms) {
  double stages_ms = 0;
  for (const auto& [name, ms] : stages)
    if (std::ranges::find(kOverlappingDurations, name) == std::end(kOverlappingDurations)) stages_ms += ms;
  stages.push_back({"other", std::max(total_ms - stages_ms, 0.0)});
  stages.push_back({"total", total_ms});
}

}  // namespace selenograph::api
