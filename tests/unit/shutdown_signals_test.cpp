#include "server/service/shutdown_signals.h"

#include <gtest/gtest.h>
#include <unistd.h>

#include <chrono>
#include <csignal>
#include <thread>

namespace selenograph::server {
namespace {

constexpr std::chrono::minutes kAtMost{10};

void signal_this_process(int signal) { ::kill(::getpid(), signal); }

// Each in a process of its own, started anew: it changes what its signals do, and has no threads of other tests.
class Signals : public ::testing::Test {
 protected:
  Signals() { GTEST_FLAG_SET(death_test_style, "threadsafe"); }
};

void finish_by(int signal) {
  ShutdownSignals signals;
  signals.arm(kAtMost);
  signal_this_process(signal);
  signals.wait();
  ::_exit(7);
}

TEST_F(Signals, AreAnEventToWaitFor) {
  for (const int signal : {SIGTERM, SIGINT}) EXPECT_EXIT(finish_by(signal), ::testing::ExitedWithCode(7), "");
}

// The system gives a signal to any thread that doesn't block it: OpenBLAS has such threads from before main().
TEST_F(Signals, DoNotEndTheProcessInALibrarysThread) {
  const auto with_a_thread_from_before = [](int signal) {
    std::thread([] {
      for (;;) ::pause();
    }).detach();
    finish_by(signal);
  };
  for (const int signal : {SIGTERM, SIGINT})
    EXPECT_EXIT(with_a_thread_from_before(signal), ::testing::ExitedWithCode(7), "");
}

TEST_F(Signals, TheSecondQuitsAtOnce) {
  const auto twice = [] {
    ShutdownSignals signals;
    signals.arm(kAtMost);
    signal_this_process(SIGTERM);
    signals.wait();
    signal_this_process(SIGINT);
    for (;;) ::pause();
  };
  EXPECT_EXIT(twice(), ::testing::ExitedWithCode(128 + SIGINT), "");
}

TEST_F(Signals, TheFirstQuitsAtOnceBeforeThereIsAnythingToFinish) {
  const auto unarmed = [] {
    const ShutdownSignals signals;
    signal_this_process(SIGTERM);
    for (;;) ::pause();
  };
  EXPECT_EXIT(unarmed(), ::testing::ExitedWithCode(128 + SIGTERM), "");
}

TEST_F(Signals, ChangeNothingWhenAllIsDone) {
  const auto afterwards = [] {
    { const ShutdownSignals signals; }
    signal_this_process(SIGTERM);
    ::_exit(7);
  };
  EXPECT_EXIT(afterwards(), ::testing::ExitedWithCode(7), "");
}

}  // namespace
}  // namespace selenograph::server
