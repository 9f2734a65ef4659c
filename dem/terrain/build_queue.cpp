#include "dem/terrain/build_queue.h"

#include <utility>

#include "dem/base/cache.h"
#include "dem/base/parallel.h"

namespace selenograph::dem {

BuildQueue::BuildQueue(int threads, TakeTurn take_turn, std::function<void()> on_idle)
    : take_turn_(std::move(take_turn)),
      on_idle_(std::move(on_idle)),
      arena_(threads > 0 ? threads : tbb::task_arena::automatic) {}

BuildQueue::~BuildQueue() {
  stop();
  if (builder_.joinable()) builder_.join();
}

void BuildQueue::stop() {
  {
    const std::lock_guard lock(mutex_);
    stopping_ = true;
  }
  work_available_.notify_all();
  job_done_.notify_all();
}

// Waits for the chunk's job. A job without waiting callers is dropped when its turn comes.
std::shared_ptr<const Chunk> BuildQueue::get(const ChunkPlan& plan, const StopToken& stop) {
  std::unique_lock lock(mutex_);
  if (stopping_) throw Cancelled();
  const std::shared_ptr<Job> job = find_or_add(plan);
  ++job->waiter_count;
  try {
    while (!job->done) {
      stop.check();
      if (stopping_) throw Cancelled();
      job_done_.wait_for(lock, kPollInterval);
    }
  } catch (...) {
    --job->waiter_count;
    throw;
  }
  --job->waiter_count;
  if (job->error) std::rethrow_exception(job->error);
  return job->chunk;
}

// Returns the job that builds a chunk; adds it to the queue, and starts the builder's thread, if there is none. The
// caller holds the lock.
std::shared_ptr<BuildQueue::Job> BuildQueue::find_or_add(const ChunkPlan& plan) {
  if (const auto found = jobs_.find(plan.node); found != jobs_.end()) return found->second;
  if (!builder_.joinable()) builder_ = std::thread([this] { run(); });
  const auto job = std::make_shared<Job>();
  job->work.plan = plan;
  queue_.push_back(job);
  jobs_[plan.node] = job;
  work_available_.notify_all();
  return job;
}

// Loop of the builder's thread: takes the first job for one turn, until stop(). A second without work counts as idle.
void BuildQueue::run() {
  std::unique_lock lock(mutex_);
  for (;;) {
    const auto has_work = [&] { return stopping_ || !queue_.empty(); };
    if (!work_available_.wait_for(lock, std::chrono::seconds(1), has_work)) {
      if (on_idle_) on_idle_();
      work_available_.wait(lock, has_work);
    }
    if (stopping_) return;
    const std::shared_ptr<Job> job = std::move(queue_.front());
    queue_.pop_front();
    if (job->waiter_count == 0) {
      release_awaited(*job);
      jobs_.erase(job->work.plan.node);
    } else if (job->awaited && !job->awaited->done) {
      queue_.push_back(job);  // the finer job, or one that it awaits, is in the queue, too
    } else {
      advance(job, lock);
    }
  }
}

// Takes one turn of a job, without the lock, and finishes the job or queues it behind the finer chunk that it needs.
void BuildQueue::advance(const std::shared_ptr<Job>& job, std::unique_lock<std::mutex>& lock) {
  if (job->awaited) {
    const std::shared_ptr<Job> finer = job->awaited;
    release_awaited(*job);
    if (finer->error) return finish(*job, nullptr, finer->error);
    job->work.finer_chunk = finer->chunk;
  }
  Turn turn;
  std::exception_ptr error;
  lock.unlock();
  try {
    const auto take = [&] { return take_turn_(job->work, StopToken(StopToken::Clock::time_point::max(), &stopping_)); };
    turn = in_arena(arena_, take);
  } catch (...) {
    error = std::current_exception();
  }
  lock.lock();
  if (!error && !turn.chunk) return await(job, *turn.needs_first);
  finish(*job, std::move(turn.chunk), error);
}

// Queues the finer chunk, then this job again; other jobs of the queue have turns in between.
void BuildQueue::await(const std::shared_ptr<Job>& job, const ChunkPlan& first) {
  job->awaited = find_or_add(first);
  ++job->awaited->waiter_count;
  job->work.finer_plan = first;
  job->work.finer_chunk.reset();
  queue_.push_back(job);
}

void BuildQueue::finish(Job& job, std::shared_ptr<const Chunk> chunk, std::exception_ptr error) {
  jobs_.erase(job.work.plan.node);
  job.chunk = std::move(chunk);
  job.error = std::move(error);
  job.done = true;
  job.work.finer = {};
  job_done_.notify_all();
}

void BuildQueue::release_awaited(Job& job) {
  if (!job.awaited) return;
  --job.awaited->waiter_count;
  job.awaited.reset();
}

}  // namespace selenograph::dem
