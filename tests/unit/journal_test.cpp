// The record of a campaign: the latest line about a name counts, whichever shard's journal has it.
#include "server/campaign/journal.h"

#include <gtest/gtest.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>
#include <string>

namespace selenograph::server {
namespace {

namespace fs = std::filesystem;

class JournalTest : public ::testing::Test {
 protected:
  JournalTest() { fs::create_directories(folder_); }
  ~JournalTest() override { fs::remove_all(folder_); }

  const std::string folder_ =
      (fs::temp_directory_path() / ("selenograph-journal-" + std::to_string(::getpid()))).string();
};

std::string frame_line(const std::string& time, const std::string& made_by, const std::string& request) {
  return R"({"time": ")" + time + R"(", "made_by": ")" + made_by + R"(", "name": "a", "line": 1, "request_sha256": ")" +
         request + R"(", "content_hash": null, "sha256": "5", "bytes": 7, "ms": 1.5, "file": "a.npz"})" + "\n";
}

TEST_F(JournalTest, WhatIsWrittenIsRead) {
  DoneFrame frame;
  frame.name = "a";
  frame.request_sha256 = "r";
  frame.bytes = 7;
  frame.file = "frames-000000.tar";
  frame.offset = 512;
  {
    Journal journal(folder_, {1, 3}, "software terrain");
    journal.add(frame);
    journal.add(DoneTar{"frames-000000.tar", "p", "s", 9, 1, {}, {}});
  }
  const Record record(folder_, "software terrain");
  ASSERT_NE(record.frame("a"), nullptr);
  EXPECT_EQ(record.frame("a")->offset, 512u);
  EXPECT_TRUE(record.frame("a")->is_in_tar());
  EXPECT_EQ(record.any_file(), "frames-000000.tar");
  ASSERT_NE(record.tar("frames-000000.tar"), nullptr);
  EXPECT_EQ(record.tar("frames-000000.tar")->plan, "p");
  EXPECT_EQ(Record(folder_, "other terrain").frame("a"), nullptr);
  EXPECT_EQ(Record(folder_, "other terrain").tar("frames-000000.tar"), nullptr);
}

TEST_F(JournalTest, TheLatestLineCountsInAnyJournal) {
  std::ofstream(folder_ + "/journal-00000-of-00001.jsonl")
      << frame_line("2026-11-20T00:00:02.000Z", "new", "second") << "{\"time\": \"20";
  std::ofstream(folder_ + "/journal-00000-of-00003.jsonl") << frame_line("2026-11-20T00:00:01.000Z", "new", "first");
  EXPECT_EQ(Record(folder_, "new").frame("a")->request_sha256, "second");
  std::ofstream(folder_ + "/journal-00001-of-00003.jsonl") << frame_line("2026-11-20T00:00:03.000Z", "old", "third");
  EXPECT_EQ(Record(folder_, "new").frame("a"), nullptr) << "the file has the bytes of other software by now";
  EXPECT_EQ(Record(folder_).frame("a")->request_sha256, "third");
}

TEST_F(JournalTest, AFrameEndsTheProblemOfItsRequest) {
  Journal journal(folder_, {0, 1}, "software terrain");
  journal.add(LineWithoutFrame{"a", 1, "r", {{"status", 500}}, {}, {}});
  ManifestLine line;
  line.name = "a";
  line.request_sha256 = "r";
  ASSERT_NE(Record(folder_).without_frame(line), nullptr);
  EXPECT_EQ(Record(folder_).without_frame(line)->problem["status"], 500);
  DoneFrame frame;
  frame.name = "a";
  frame.request_sha256 = "r";
  frame.file = "a.npz";
  journal.add(frame);
  EXPECT_EQ(Record(folder_).without_frame(line), nullptr);
}

}  // namespace
}  // namespace selenograph::server
