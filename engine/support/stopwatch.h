// Lap times of a steady clock.
#pragma once

#include <chrono>

namespace selenograph::engine {

class Stopwatch {
 public:
  // Returns the time since construction or the last call.
  double lap_ms() {
    const auto now = std::chrono::steady_clock::now();
    const double ms = std::chrono::duration<double, std::milli>(now - start_).count();
    start_ = now;
    return ms;
  }

 private:
  std::chrono::steady_clock::time_point start_ = std::chrono::steady_clock::now();
};

}  // namespace selenograph::engine
