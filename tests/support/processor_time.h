// Processor time, which unlike wall time does not grow with the machine's other work.
#pragma once

#include <ctime>
#include <thread>

namespace selenograph::test {

// Returns the processor time that all threads of this process have used, s.
inline double processor_s() { return static_cast<double>(std::clock()) / CLOCKS_PER_SEC; }

// Returns the processor time that a call takes, s, divided by the number of the machine's cores.
template <typename Work>
double processor_s_per_core(const Work& work) {
  const double before_s = processor_s();
  work();
  return (processor_s() - before_s) / std::thread::hardware_concurrency();
}

}  // namespace selenograph::test
