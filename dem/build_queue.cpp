#include "dem/build_queue.h"

#include <utility>

#include "dem/cache.h"
#include "dem/parallel.h"

namespace selenograph::dem {

BuildQueue::BuildQueue(int threads, TakeTurn take_turn, std::function<void()> rest)
    : take_turn_(std::move(take_turn)),
      rest_(std::move(rest)),
      arena_(threads > 0 ? threads : tbb::task_arena::automatic) {}

BuildQueue::~BuildQueue() {
  stop();
  if (thread_.joinable()) thread_.join();
}

void BuildQueue::stop() {
  {
    const std::lock_guard lock(mutex_);
    stopping_ = true;
  }
  added_.notify_all();
  landed_.notify_all();
}

std::shared_ptr<const Chunk> BuildQueue::get(const ChunkPlan& plan, const StopToken& stop) {
  std::unique_lock lock(mutex_);
  if (stopping_) throw Cancelled();
  if (!thread_.joinable()) thread_ = std::thread([this] { run(); });
  const std::shared_ptr<Job> job = find_or_add(plan);
  ++job->wanted;
  try {
    while (!job->done) {
      stop.check();
      if (stopping_) throw Cancelled();
      landed_.wait_for(lock, kLookUp);
    }
  } catch (...) {
    --job->wanted;
    throw;
  }
  --job->wanted;
  if (job->error) std::rethrow_exception(job->error);
  return job->chunk;
}

std::shared_ptr<BuildQueue::Job> BuildQueue::find_or_add(const ChunkPlan& plan) {
  std::shared_ptr<Job>& job = jobs_[plan.node];
  if (!job) {
    job = std::make_shared<Job>();
    job->work.plan = plan;
    queue_.push_back(job);
    added_.notify_all();
  }
  return job;
}

void BuildQueue::run() {
  std::unique_lock lock(mutex_);
  for (;;) {
    const auto something_to_do = [&] { return stopping_ || !queue_.empty(); };
    if (!added_.wait_for(lock, std::chrono::seconds(1), something_to_do)) {
      if (rest_) rest_();
      added_.wait(lock, something_to_do);
    }
    if (stopping_) return;
    const std::shared_ptr<Job> job = std::move(queue_.front());
    queue_.pop_front();
    if (job->wanted == 0) {
      let_go(*job);
      jobs_.erase(job->work.plan.node);
    } else if (job->awaited && !job->awaited->done) {
      queue_.push_back(job);  // what it needs stands before it
    } else {
      advance(job, lock);
    }
  }
}

void BuildQueue::advance(const std::shared_ptr<Job>& job, std::unique_lock<std::mutex>& lock) {
  if (job->awaited) {
    const std::shared_ptr<Job> finer = job->awaited;
    let_go(*job);
    if (finer->error) return finish(*job, nullptr, finer->error);
    job->work.made = finer->chunk;
  }
  Turn turn;
  std::exception_ptr error;
  lock.unlock();
  try {
    turn = in_arena(arena_,
                    [&] { return take_turn_(job->work, StopToken(StopToken::Clock::time_point::max(), &stopping_)); });
  } catch (...) {
    error = std::current_exception();
  }
  lock.lock();
  if (error || turn.chunk)
    finish(*job, std::move(turn.chunk), error);
  else
    await(job, *turn.needs_first);
}

// The finer chunk comes first, then this one again; others in the queue have their turns between.
void BuildQueue::await(const std::shared_ptr<Job>& job, const ChunkPlan& first) {
  job->work.asked_for = first;
  job->work.made.reset();
  job->awaited = find_or_add(first);
  ++job->awaited->wanted;
  queue_.push_back(job);
}

void BuildQueue::finish(Job& job, std::shared_ptr<const Chunk> chunk, std::exception_ptr error) {
  jobs_.erase(job.work.plan.node);
  job.chunk = std::move(chunk);
  job.error = std::move(error);
  job.done = true;
  job.work.finer = {};
  landed_.notify_all();
}

void BuildQueue::let_go(Job& job) {
  if (!job.awaited) return;
  --job.awaited->wanted;
  job.awaited.reset();
}

}  // namespace selenograph::dem
