// The header Server-Timing (https://www.w3.org/TR/server-timing/).
#pragma once

#include <fmt/format.h>

#include <algorithm>
#include <string>
#include <string_view>

#include "api/message/message.h"

namespace selenograph::api {

// Parts of stages, and the system's time meanwhile. All other durations are disjoint stages.
inline constexpr std::string_view kPartsOfStages[] = {"pyramid", "load", "draw", "resolve", "shadow", "touch"};

inline std::string timing_text(const StageTimes& stages) {
  std::string text;
  for (const auto& [name, ms] : stages) text += fmt::format("{}{};dur={:.3f}", text.empty() ? "" : ", ", name, ms);
  return text;
}

// Adds the time that no stage has, and the total.
inline void complete_timing(StageTimes& stages, double total_ms) {
  double stages_ms = 0;
  for (const auto& [name, ms] : stages)
    if (std::ranges::find(kPartsOfStages, name) == std::end(kPartsOfStages)) stages_ms += ms;
  stages.push_back({"other", std::max(total_ms - stages_ms, 0.0)});
  stages.push_back({"total", total_ms});
}

}  // namespace selenograph::api
