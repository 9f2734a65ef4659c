// Programs as children, and what a process can no longer do.
#include "engine/support/child_process.h"

#include <fcntl.h>
#include <gtest/gtest.h>
#include <signal.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cerrno>
#include <chrono>
#include <cstdlib>
#include <fstream>

#include "dem/base/error.h"
#include "engine/support/confinement.h"
#include "tests/support/shared_data.h"

namespace selenograph::engine {
namespace {

using namespace std::chrono_literals;
using Clock = std::chrono::steady_clock;

constexpr ChildLimits kPatient{30s, 1 << 20};

std::string answer_of(const std::string& script, const ChildLimits& limits = kPatient, const StopToken& stop = {}) {
  const int input = ::open("/dev/null", O_RDONLY | O_CLOEXEC);
  struct Close {
    int descriptor;
    ~Close() { ::close(descriptor); }
  } close{input};
  return run_child("/bin/sh", {"-c", script}, input, limits, stop);
}

std::string fault_of(const std::string& script, const ChildLimits& limits = kPatient) {
  try {
    answer_of(script, limits);
  } catch (const ChildFailed& e) {
    return e.what();
  }
  return "";
}

TEST(ChildProcess, AnswersWhatItWrites) {
  EXPECT_EQ(answer_of("printf '\\3\\0\\0\\0\\0\\0\\0\\0abc'"), "abc");
  EXPECT_EQ(answer_of("printf '\\0\\0\\0\\0\\0\\0\\0\\0'"), "");
}

TEST(ChildProcess, HasThreeFilesAndNoOther) {
  const test::TemporaryFolder folder;
  const int extra = ::open(folder.path().c_str(), O_RDONLY);  // without close-on-exec
  // The shell's own look into the folder is the fourth.
  EXPECT_EQ(answer_of("set -- /proc/self/fd/*; printf '\\1\\0\\0\\0\\0\\0\\0\\0%d' $#"), "4");
  ::close(extra);
}

TEST(ChildProcess, SaysHowItEnded) {
  EXPECT_EQ(fault_of("exit 3"), "ended with status 3 before its answer was whole");
  EXPECT_EQ(fault_of("printf '\\3\\0\\0\\0\\0\\0\\0\\0ab'"), "ended with status 0 before its answer was whole");
  EXPECT_EQ(fault_of("kill -SEGV $$"), "ended by signal 11 (Segmentation fault)");
  EXPECT_EQ(fault_of("printf '\\0\\0\\0\\0\\1\\0\\0\\0'; exec sleep 60"),
            "has an answer of 4294967296 bytes, more than 1048576");
  EXPECT_THROW(run_child("/no/such/program", {}, 0, kPatient, {}), ChildFailed);
}

TEST(ChildProcess, EndsWithItsTime) {
  const test::TemporaryFolder folder;
  const std::string noted = folder / "process";
  const auto start = Clock::now();
  EXPECT_EQ(fault_of("echo $$ > " + noted + "; exec sleep 60", {300ms, 100}), "took more than 0.3 s");
  // Also when it closes its answer and stays.
  EXPECT_EQ(fault_of("exec >&-; exec sleep 60", {300ms, 100}), "took more than 0.3 s");
  EXPECT_LT(Clock::now() - start, 5s);
  pid_t process = 0;
  std::ifstream(noted) >> process;
  ASSERT_GT(process, 0);
  EXPECT_EQ(::kill(process, 0), -1) << "it is gone";
  EXPECT_EQ(errno, ESRCH);
}

TEST(ChildProcess, EndsWithTheRequest) {
  const auto start = Clock::now();
  EXPECT_THROW(answer_of("exec sleep 60", kPatient, StopToken(start + 100ms)), Cancelled);
  EXPECT_LT(Clock::now() - start, 5s);
}

// How a process ends that is confined and then does `work`.
int status_of(void (*work)()) {
  const pid_t process = ::fork();
  if (process == 0) {
    confine(std::size_t{64} << 20, 20);
    work();
    ::_exit(0);
  }
  int status = 0;
  ::waitpid(process, &status, 0);
  return status;
}

TEST(Confinement, LeavesComputing) {
  EXPECT_EQ(status_of([] {
              std::vector<char> some(1 << 20, 'x');
              ::_exit(some[77] == 'x' ? 0 : 1);
            }),
            0);
}

TEST(Confinement, BoundsMemory) {
  if (kSanitized) GTEST_SKIP() << "sanitizers reserve addresses without end";
  const int status = status_of([] { ::_exit(std::malloc(std::size_t{256} << 20) ? 1 : 7); });
  EXPECT_EQ(WEXITSTATUS(status), 7);
}

}  // namespace
}  // namespace selenograph::engine
