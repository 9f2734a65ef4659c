#include "dem/terrain/build_queue.h"

#include <algorithm>
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
  for (Builder& builder : builders_)
    if (builder.thread.joinable()) builder.thread.join();
}

void BuildQueue::stop() {
  {
    const std::lock_guard lock(mutex_);
    stopping_ = true;
  }
  work_available_.notify_all();
  job_done_.notify_all();
}

// Waits for the chunk's job. A job without waiting callers is dropped by its builder.
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
    if (--job->waiter_count == 0) work_available_.notify_all();  // let the builder drop the job
    throw;
  }
  --job->waiter_count;
  if (job->error) std::rethrow_exception(job->error);
  return job->chunk;
}

// Returns the job that builds a chunk; adds it to its builder's queue, and starts that builder's thread, if there is
// none. The caller holds the lock.
std::shared_ptr<BuildQueue::Job> BuildQueue::find_or_add(const ChunkPlan& plan) {
  if (const auto found = jobs_.find(plan.node); found != jobs_.end()) return found->second;
  Builder& builder = builders_[plan.on_network];
  if (!builder.thread.joinable())
    builder.thread = std::thread([this, on_network = plan.on_network] { run(on_network); });
  const auto job = std::make_shared<Job>();
  job->work.plan = plan;
  builder.queue.push_back(job);
  jobs_[plan.node] = job;
  work_available_.notify_all();
  return job;
}

// Returns whether a builder can take a job: to drop it, or for a turn.
bool BuildQueue::can_go_on(const Job& job) { return job.waiter_count == 0 || !job.awaited || job.awaited->done; }

// Loop of one builder's thread: takes the first job that can go on, for one turn, until stop(). A second without work
// counts as idle.
void BuildQueue::run(bool on_network) {
  std::unique_lock lock(mutex_);
  std::deque<std::shared_ptr<Job>>& queue = builders_[on_network].queue;
  const auto find_next = [&] {
    return std::find_if(queue.begin(), queue.end(), [](const auto& job) { return can_go_on(*job); });
  };
  for (;;) {
    const auto has_work = [&] { return stopping_ || find_next() != queue.end(); };
    if (!work_available_.wait_for(lock, std::chrono::seconds(1), has_work)) {
      if (on_idle_ && !on_network) on_idle_();
      work_available_.wait(lock, has_work);
    }
    if (stopping_) return;
    const auto position = find_next();
    const std::shared_ptr<Job> job = std::move(*position);
    queue.erase(position);
    if (job->waiter_count == 0) {
      release_awaited(*job);
      jobs_.erase(job->work.plan.node);
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
    turn = job->work.plan.on_network ? on_own_threads(kNetworkReaders, take) : in_arena(arena_, take);
  } catch (...) {
    error = std::current_exception();
  }
  lock.lock();
  try {
    if (!error && !turn.chunk) return await(job, *turn.needs_first);
  } catch (...) {  // the system has no thread for the other builder
    error = std::current_exception();
  }
  finish(*job, std::move(turn.chunk), error);
}

// Queues the finer chunk, then this job again; other jobs of the queue have turns in between.
void BuildQueue::await(const std::shared_ptr<Job>& job, const ChunkPlan& first) {
  job->awaited = find_or_add(first);
  ++job->awaited->waiter_count;
  job->work.finer_plan = first;
  job->work.finer_chunk.reset();
  builders_[job->work.plan.on_network].queue.push_back(job);
}

void BuildQueue::finish(Job& job, std::shared_ptr<const Chunk> chunk, std::exception_ptr error) {
  jobs_.erase(job.work.plan.node);
  job.chunk = std::move(chunk);
  job.error = std::move(error);
  job.done = true;
  job.work.finer = {};
  job_done_.notify_all();
  work_available_.notify_all();  // jobs that awaited this one can take a turn
}

void BuildQueue::release_awaited(Job& job) {
  if (!job.awaited) return;
  if (--job.awaited->waiter_count == 0) work_available_.notify_all();
  job.awaited.reset();
}

}  // namespace selenograph::dem
