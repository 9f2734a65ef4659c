#include "engine/cache/preparation.h"

#include <algorithm>
#include <exception>
#include <utility>

#include "dem/base/error.h"
#include "dem/grid/rotation.h"

namespace selenograph::engine {
namespace {

// Largest motion between two frames of one track. A camera that moved farther is a different camera, or was moved by
// hand.
constexpr double kMaxStep_m = 20000, kMaxTurn_rad = 0.4;

bool same(const Pose& a, const Pose& b) {
  return a.position_m == b.position_m && a.camera_from_moon == b.camera_from_moon;
}

// Limits of the Sun's motion between two frames. A Sun that moved farther than kMaxSun_rad was set by hand. Motion
// below kMinSun_rad is rounding: the real Sun takes 0.4 ms for it.
constexpr double kMaxSun_rad = 0.01, kMinSun_rad = 1e-9;

// Returns the direction after repeating the rotation from `before` to `now` `steps` times.
Vec3 extrapolated(const Vec3& before, const Vec3& now, int steps) {
  const double angle = (now - before).norm();
  if (angle <= kMinSun_rad || angle > kMaxSun_rad) return now;
  const Vec3 axis = before.cross(now).normalized();
  return AngleAxis(steps * angle, axis) * now;
}

}  // namespace

Preparation::Preparation(Prepare prepare, StopToken::Clock::duration budget)
    : prepare_(std::move(prepare)), budget_(budget) {}

Preparation::~Preparation() {
  {
    const std::lock_guard lock(mutex_);
    stopping_ = cancel_ = true;
  }
  changed_.notify_all();
  if (thread_.joinable()) thread_.join();
}

bool Preparation::PoseAndSun::operator==(const PoseAndSun& other) const {
  return same(pose, other.pose) && (sun - other.sun).norm() <= kMinSun_rad;
}

Preparation::Work::Work(Preparation& preparation) : preparation_(preparation) {
  const std::lock_guard lock(preparation_.mutex_);
  ++preparation_.active_work_;
}

Preparation::Work::Work(Preparation& preparation, const FrameRequest* frame) : preparation_(preparation) {
  const std::lock_guard lock(preparation_.mutex_);
  ++preparation_.active_work_;
  if (preparation_.current_ && !(frame && *preparation_.current_ == pose_and_sun_of(*frame)))
    preparation_.cancel_ = true;
}

Preparation::Work::~Work() {
  {
    const std::lock_guard lock(preparation_.mutex_);
    --preparation_.active_work_;
  }
  preparation_.changed_.notify_all();
}

// Returns the track that a frame continues, or a new one, as the first of the tracks: the last one is dropped when
// there are too many. A frame continues a track of the same name and camera if its pose is near the track's last.
Preparation::Track& Preparation::track_of(const FrameRequest& frame, std::string_view name) {
  const auto continues = [&](const Pose& last) {
    return (last.position_m - frame.pose.position_m).norm() <= kMaxStep_m &&
           last.camera_from_moon.angle_to(frame.pose.camera_from_moon) <= kMaxTurn_rad;
  };
  const auto found = std::find_if(tracks_.begin(), tracks_.end(), [&](const Track& track) {
    return track.name == name && track.last.camera == frame.camera && continues(track.last.pose);
  });
  if (found != tracks_.end()) {
    std::rotate(tracks_.begin(), found, found + 1);
  } else {
    tracks_.push_front({++next_track_, std::string(name), frame});
    if (tracks_.size() > kMaxTracks) tracks_.pop_back();
  }
  return tracks_.front();
}

// Returns the track of an entry; null if the track was dropped or has had a newer frame since.
Preparation::Track* Preparation::find_track(const Expected& next) {
  const auto found = std::ranges::find(tracks_, next.track, &Track::number);
  return found == tracks_.end() || found->frame != next.frame ? nullptr : &*found;
}

void Preparation::forget_expected(std::uint64_t track) {
  std::erase_if(expected_, [&](const Expected& e) { return e.track == track; });
}

const Preparation::Prepared* Preparation::Track::find_prepared(const PoseAndSun& state) const {
  const auto found =
      std::find_if(prepared.begin(), prepared.end(), [&](const Prepared& r) { return r.state == state; });
  return found == prepared.end() ? nullptr : &*found;
}

// Drops the track's prepared scenes that are not for an upcoming frame or no longer cached. Asking whether a scene is
// cached marks it as used, so ask in reverse: the soonest frame's scene becomes the most recently used, and the LRU
// cache evicts the scene of the farthest frame first.
void Preparation::drop_stale(Track& track, std::span<const PoseAndSun> upcoming) {
  std::vector<Prepared> still_cached;
  for (auto state = upcoming.rbegin(); state != upcoming.rend(); ++state)
    if (const Prepared* scene = track.find_prepared(*state); scene && scene->is_still_cached())
      still_cached.push_back(*scene);
  track.prepared = std::move(still_cached);
}

// Inserts after the entries of the same step: tracks take turns, and all get their soonest frames first.
void Preparation::enqueue(Expected next) {
  const auto later =
      std::find_if(expected_.begin(), expected_.end(), [&](const Expected& e) { return e.step > next.step; });
  expected_.insert(later, std::move(next));
}

std::vector<Preparation::PoseAndSun> Preparation::upcoming_states(const Vec3& sun_before, const Vec3& sun,
                                                                  std::span<const Pose> ahead) {
  std::vector<PoseAndSun> upcoming;
  for (const Pose& pose : ahead)
    upcoming.push_back({pose, extrapolated(sun_before, sun, static_cast<int>(upcoming.size()) + 1)});
  return upcoming;
}

void Preparation::expect(const FrameRequest& frame, std::span<const Pose> ahead, std::string_view name) {
  // Ignore failures to allocate or to start the thread: nothing is prepared then, and the frame is already answered.
  try {
    const std::lock_guard lock(mutex_);
    if (stopping_) return;
    Track& track = track_of(frame, name);
    const Vec3 sun_before = std::exchange(track.last, frame).sun.direction;
    track.budget_left = budget_;
    ++track.frame;
    forget_expected(track.number);
    const std::vector<PoseAndSun> upcoming = upcoming_states(sun_before, frame.sun.direction, ahead);
    drop_stale(track, upcoming);
    for (std::size_t step = 0; step < upcoming.size(); ++step) {
      if (track.find_prepared(upcoming[step])) continue;
      Expected next{track.number, track.frame, step, frame};
      next.request.pose = upcoming[step].pose;
      next.request.sun.direction = upcoming[step].sun;
      enqueue(std::move(next));
    }
    if (!thread_.joinable() && !expected_.empty()) thread_ = std::thread([this] { run(); });
  } catch (const std::exception&) {
  }
  changed_.notify_all();
}

void Preparation::wait_until_done() {
  std::unique_lock lock(mutex_);
  changed_.wait(lock, [&] { return stopping_ || (expected_.empty() && !current_); });
}

// The preparation thread's loop. It takes the queue's first entry while no Work exists, and prepares its scene
// unlocked. The time spent is charged to the track. A cancelled entry returns to the front of the queue.
void Preparation::run() {
  using Clock = StopToken::Clock;
  std::unique_lock lock(mutex_);
  for (;;) {
    changed_.wait(lock, [&] { return stopping_ || (active_work_ == 0 && !expected_.empty()); });
    if (stopping_) return;
    const Expected next = std::move(expected_.front());
    expected_.pop_front();
    const Track* const track = find_track(next);
    const auto budget_left = track ? track->budget_left : Clock::duration::zero();
    current_ = pose_and_sun_of(next.request);
    cancel_ = false;
    lock.unlock();
    const Clock::time_point start = Clock::now();
    const Outcome outcome =
        budget_left > Clock::duration::zero() ? prepare(next, start + budget_left) : Outcome::out_of_budget;
    const Clock::duration spent = Clock::now() - start;
    lock.lock();
    current_.reset();
    if (Track* const charged = find_track(next)) {
      charged->budget_left -= spent;
      if (outcome == Outcome::cancelled) requeue(next);
      if (outcome == Outcome::out_of_budget) forget_expected(next.track);
    }
    changed_.notify_all();
  }
}

Preparation::Outcome Preparation::prepare(const Expected& next, StopToken::Clock::time_point deadline) {
  try {
    record_prepared(next, prepare_(next.request, StopToken(deadline, &cancel_)));
  } catch (const Cancelled&) {
    return cancel_ ? Outcome::cancelled : Outcome::out_of_budget;
  } catch (const std::exception&) {
    // Ignore the error: the frame reports it itself if it is requested.
  }
  return Outcome::done;
}

// Records the scene with its track, unless the track was dropped meanwhile. If the track expects something else by now,
// its next call of drop_stale() removes the entry.
void Preparation::record_prepared(const Expected& next, const IsStillCached& is_still_cached) {
  const std::lock_guard lock(mutex_);
  for (Track& track : tracks_)
    if (track.number == next.track) track.prepared.push_back({pose_and_sun_of(next.request), is_still_cached});
}

void Preparation::requeue(const Expected& next) {
  try {
    expected_.push_front(next);
  } catch (const std::exception&) {
    // Drop the entry if there is no memory for it: then there is none for its scene either.
  }
}

}  // namespace selenograph::engine
