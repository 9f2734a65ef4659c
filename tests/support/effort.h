// Effort of tests with many cases: a run does a part of them, or all with SELENOGRAPH_TEST_EFFORT=full (slow.full).
#pragma once

#include <cstdlib>
#include <string_view>

namespace selenograph::test {

inline bool full_effort() {
  const char* const effort = std::getenv("SELENOGRAPH_TEST_EFFORT");
  return effort && std::string_view(effort) == "full";
}
inline int cases(int all) { return full_effort() ? all : all / 4; }

}  // namespace selenograph::test
