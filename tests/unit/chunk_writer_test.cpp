// Chunks on their way to the cache folder.
#include "dem/terrain/chunk_writer.h"

#include <gtest/gtest.h>

#include <atomic>
#include <chrono>
#include <future>
#include <thread>
#include <vector>

namespace selenograph::dem {
namespace {

using namespace std::chrono_literals;

ChunkWriter::Job job(int column) {
  ChunkPlan plan;
  plan.node = {kRootLevel, 20, column};
  return {plan, std::make_shared<const Chunk>()};
}

// What has been written, one at a time and each only when it may.
class Disk {
 public:
  void write(const ChunkWriter::Job& job) {
    EXPECT_FALSE(writing_.exchange(true)) << "two at a time";
    for (const auto limit = std::chrono::steady_clock::now() + 20s;
         allowed_ <= 0 && std::chrono::steady_clock::now() < limit;)
      std::this_thread::sleep_for(1ms);
    --allowed_;
    written_.push_back(job.plan.node.col);
    writing_ = false;
  }
  void allow(int more) { allowed_ += more; }
  const std::vector<int>& written() const { return written_; }

 private:
  std::atomic<int> allowed_{0};
  std::atomic<bool> writing_{false};
  std::vector<int> written_;
};

TEST(ChunkWriter, WritesInOrderAndReportsPendingChunks) {
  Disk disk;
  ChunkWriter writer([&](const ChunkWriter::Job& j) { disk.write(j); });
  const ChunkWriter::Job first = job(1), second = job(2);
  EXPECT_FALSE(writer.find(first.plan.node));
  writer.add(first);
  writer.add(second);
  EXPECT_EQ(writer.find(first.plan.node), first.chunk) << "it is being written";
  EXPECT_EQ(writer.find(second.plan.node), second.chunk);
  EXPECT_FALSE(writer.find(job(3).plan.node));
  disk.allow(2);
  writer.wait_until_done();
  EXPECT_FALSE(writer.find(first.plan.node));
  EXPECT_EQ(disk.written(), (std::vector{1, 2}));
}

TEST(ChunkWriter, QueueIsBounded) {
  Disk disk;
  ChunkWriter writer([&](const ChunkWriter::Job& j) { disk.write(j); });
  writer.add(job(1));
  writer.add(job(2));
  auto third = std::async(std::launch::async, [&] { writer.add(job(3)); });
  EXPECT_EQ(third.wait_for(100ms), std::future_status::timeout) << "two are in memory already";
  disk.allow(1);
  EXPECT_EQ(third.wait_for(20s), std::future_status::ready);
  disk.allow(2);
  writer.wait_until_done();
  EXPECT_EQ(disk.written(), (std::vector{1, 2, 3}));
}

TEST(ChunkWriter, DestructorWaitsForAllWrites) {
  Disk disk;
  {
    ChunkWriter writer([&](const ChunkWriter::Job& j) { disk.write(j); });
    writer.add(job(1));
    writer.add(job(2));
    disk.allow(2);
  }
  EXPECT_EQ(disk.written(), (std::vector{1, 2}));
  ChunkWriter([](const ChunkWriter::Job&) {}).wait_until_done();  // nothing at all
}

}  // namespace
}  // namespace selenograph::dem
