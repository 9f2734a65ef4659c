// Programs that read a file as a child, how they end, and what limits them.
#include "engine/support/confined_reader.h"

#include <fcntl.h>
#include <gtest/gtest.h>
#include <signal.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include <atomic>
#include <cerrno>
#include <chrono>
#include <filesystem>
#include <fstream>
#include <stdexcept>
#include <thread>

#include "dem/base/error.h"
#include "tests/support/shared_data.h"

namespace selenograph::engine {
namespace {

using namespace std::chrono_literals;

// Shell scripts in the child's place.
class ConfinedReading : public ::testing::Test {
 protected:
  std::string answer_of(const std::string& script, const StopToken& stop = {}) const {
    const std::string program = folder_ / "program";
    std::ofstream(program) << "#!/bin/sh\n" << script << '\n';
    ::chmod(program.c_str(), 0700);
    return ConfinedReader({program}).read("read-it", "a.file", stop);
  }
  std::string fault_of(const std::string& script) const {
    try {
      answer_of(script);
    } catch (const DataError& e) {
      EXPECT_EQ(e.file(), "a.file");
      return e.what_is_wrong();
    }
    return "";
  }
  test::TemporaryFolder folder_;
};

TEST_F(ConfinedReading, AnswersWhatTheChildWrites) {
  EXPECT_EQ(answer_of("printf 'ab\\0c'"), std::string("ab\0c", 4));
  EXPECT_EQ(answer_of("echo $1 $2 $3"), "read-it a.file 1073741824\n");
  EXPECT_EQ(answer_of("head -c 3000000 /dev/zero").size(), 3000000U);
}

TEST_F(ConfinedReading, TheChildHasThreeFilesAndNoOther) {
  const int extra = ::open(folder_.path().c_str(), O_RDONLY);  // without close-on-exec
  // The shell's script and its own look into the folder come in addition.
  EXPECT_EQ(answer_of("set -- /proc/self/fd/*; echo $#"), "5\n");
  ::close(extra);
}

TEST_F(ConfinedReading, ErrorsSayHowTheChildEnded) {
  EXPECT_EQ(fault_of("printf 'no mesh'; exit 3"), "no mesh");
  EXPECT_EQ(fault_of("exit 4"), "takes more than 1024 MiB to read (--mesh-mb)");
  EXPECT_EQ(fault_of("printf abc; exit 7"), "cannot be read: its reader ended with status 7");
  EXPECT_EQ(fault_of("kill -SEGV $$"), "cannot be read: its reader ended with Segmentation fault");
  EXPECT_EQ(fault_of("kill -XCPU $$"), "cannot be read: its reader ended with CPU time limit exceeded");
  EXPECT_THROW(ConfinedReader({"/no/such/program"}).read("read-it", "a.file"), SystemFault);
  EXPECT_THROW(ConfinedReader({}).read("read-it", "a.file"), DataError);
}

TEST_F(ConfinedReading, TheChildEndsWithTheRequest) {
  const std::string noted = folder_ / "process";
  std::atomic<bool> abandoned = false;
  std::thread client([&] {
    while (!std::filesystem::exists(noted)) std::this_thread::sleep_for(1ms);
    abandoned = true;
  });
  const StopToken stop(StopToken::Clock::time_point::max(), &abandoned);
  EXPECT_THROW(answer_of("echo $$ > " + noted + ".new; mv " + noted + ".new " + noted + "; exec sleep 600", stop),
               Cancelled);
  client.join();
  pid_t process = 0;
  std::ifstream(noted) >> process;
  ASSERT_GT(process, 0);
  EXPECT_EQ(::kill(process, 0), -1) << "it is gone";
  EXPECT_EQ(errno, ESRCH);
}

// --- the child's side, in a fork

struct Ended {
  int status;
  std::string answer;
};

Ended end_of(const ParseFile& parse) {
  int ends[2];
  EXPECT_EQ(::pipe(ends), 0);
  const pid_t process = ::fork();
  if (process == 0) {
    ::dup2(ends[1], STDOUT_FILENO);
    std::string words[] = {"program", "read-it", "a.file", std::to_string(std::size_t{64} << 20)};
    char* arguments[] = {words[0].data(), words[1].data(), words[2].data(), words[3].data(), nullptr};
    ::_exit(read_in_child(4, arguments, parse));
  }
  ::close(ends[1]);
  Ended ended{};
  char buffer[1000];
  for (ssize_t size; (size = ::read(ends[0], buffer, sizeof buffer)) > 0;)
    ended.answer.append(buffer, static_cast<std::size_t>(size));
  ::close(ends[0]);
  ::waitpid(process, &ended.status, 0);
  return ended;
}

TEST(ReadInChild, AnswersWithTheFileOrTheReason) {
  const Ended read =
      end_of([](const std::string& path, std::size_t max_bytes) { return path + " " + std::to_string(max_bytes); });
  EXPECT_EQ(WEXITSTATUS(read.status), 0);
  EXPECT_EQ(read.answer, "a.file 67108864");
  const Ended refused =
      end_of([](const std::string& path, std::size_t) -> std::string { throw DataError(path, "is no mesh"); });
  EXPECT_EQ(WEXITSTATUS(refused.status), 3);
  EXPECT_EQ(refused.answer, "is no mesh");
  const Ended failed = end_of([](const std::string&, std::size_t) -> std::string { throw std::out_of_range("far"); });
  EXPECT_EQ(WEXITSTATUS(failed.status), 3);
  EXPECT_EQ(failed.answer, "far");
}

TEST(ReadInChild, ProcessorTimeIsLimited) {
  const Ended ended = end_of([](const std::string&, std::size_t) {
    rlimit limits{};
    ::getrlimit(RLIMIT_CPU, &limits);
    return std::to_string(limits.rlim_cur);
  });
  EXPECT_EQ(ended.answer, "20");
}

TEST(ReadInChild, MemoryIsLimited) {
#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
  GTEST_SKIP() << "sanitizers reserve addresses without end";
#endif
  const Ended some = end_of([](const std::string&, std::size_t) { return std::string(1 << 20, 'x').substr(0, 1); });
  EXPECT_EQ(some.answer, "x");
  const Ended much = end_of([](const std::string&, std::size_t max_bytes) { return std::string(4 * max_bytes, 'x'); });
  EXPECT_EQ(WEXITSTATUS(much.status), 4);
  EXPECT_EQ(much.answer, "");
}

}  // namespace
}  // namespace selenograph::engine
