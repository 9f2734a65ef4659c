#include "dem/terrain/chunk_writer.h"

#include <algorithm>
#include <utility>

namespace selenograph::dem {

ChunkWriter::ChunkWriter(std::function<void(const Job&)> write) : write_(std::move(write)) {}

ChunkWriter::~ChunkWriter() {
  {
    const std::lock_guard lock(mutex_);
    stopping_ = true;
  }
  changed_.notify_all();
  if (thread_.joinable()) thread_.join();
}

void ChunkWriter::add(Job job) {
  std::unique_lock lock(mutex_);
  changed_.wait(lock, [&] { return jobs_.size() < kMaxJobs; });
  if (!thread_.joinable()) thread_ = std::thread([this] { run(); });
  jobs_.push_back(std::move(job));
  changed_.notify_all();
}

std::shared_ptr<const Chunk> ChunkWriter::find(const BlockId& node) const {
  const std::lock_guard lock(mutex_);
  const auto found = std::find_if(jobs_.begin(), jobs_.end(), [&](const Job& job) { return job.plan.node == node; });
  return found == jobs_.end() ? nullptr : found->chunk;
}

void ChunkWriter::wait_until_done() {
  std::unique_lock lock(mutex_);
  changed_.wait(lock, [&] { return jobs_.empty(); });
}

void ChunkWriter::run() {
  std::unique_lock lock(mutex_);
  for (;;) {
    changed_.wait(lock, [&] { return stopping_ || !jobs_.empty(); });
    if (jobs_.empty()) return;
    // Copy the job, so that find() has it until its file is complete.
    const Job job = jobs_.front();
    lock.unlock();
    write_(job);
    lock.lock();
    jobs_.pop_front();
    changed_.notify_all();
  }
}

}  // namespace selenograph::dem
