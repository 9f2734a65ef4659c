#include "engine/cache/preparation.h"

#include <algorithm>
#include <array>
#include <exception>
#include <utility>

#include "dem/base/error.h"

namespace selenograph::engine {
namespace {

// A camera that was farther away a frame ago, or looked elsewhere, is another one, or was moved by hand.
constexpr double kFarthestStep_m = 20000, kWidestTurn_rad = 0.4;
// Frames that are expected of a camera whose client says nothing: the next ones, and some that are far ahead where they
// take long to prepare, with detail or light from terrain.
constexpr std::array kExtrapolated{1, 2};
constexpr std::array kExtrapolatedFarther{1, 2, 6, 14};

bool same(const Pose& a, const Pose& b) {
  return a.position_m == b.position_m && a.camera_from_moon.coeffs() == b.camera_from_moon.coeffs();
}

// A Sun that moved farther in a frame was set by hand. What moves less is rounding: the real one takes 0.4 ms.
constexpr double kFarthestSun_rad = 0.01, kNearestSun_rad = 1e-9;
// While it moves less in a frame, a camera that hovers needs no other scene. Its light from terrain is another one from
// one moment to the next, though (light_tile.h). The real Sun takes a second.
constexpr double kSlowSun_rad = 3e-6;

// Moved on and turned on as from `before` to `now`, `steps` times.
Pose extrapolated(const Pose& before, const Pose& now, int steps) {
  Pose pose = now;
  const Eigen::Quaterniond turn = now.camera_from_moon * before.camera_from_moon.conjugate();
  for (int k = 0; k < steps; ++k) {
    pose.position_m += now.position_m - before.position_m;
    pose.camera_from_moon = (turn * pose.camera_from_moon).normalized();
  }
  return pose;
}

// As turned from `before` to `now`, `steps` times.
Vec3 extrapolated(const Vec3& before, const Vec3& now, int steps) {
  const double angle = (now - before).norm();
  if (angle <= kNearestSun_rad || angle > kFarthestSun_rad) return now;
  const Vec3 axis = before.cross(now).normalized();
  return Eigen::AngleAxisd(steps * angle, axis) * now;
}

}  // namespace

Preparation::Preparation(Prepare prepare, StopToken::Clock::duration budget)
    : prepare_(std::move(prepare)), budget_(budget) {}

Preparation::~Preparation() {
  {
    const std::lock_guard lock(mutex_);
    stopping_ = give_up_ = true;
  }
  changed_.notify_all();
  if (thread_.joinable()) thread_.join();
}

bool Preparation::Moment::operator==(const Moment& other) const {
  return same(pose, other.pose) && (sun - other.sun).norm() <= kNearestSun_rad;
}

Preparation::Work::Work(Preparation& preparation) : preparation_(preparation) {
  const std::lock_guard lock(preparation_.mutex_);
  ++preparation_.in_work_;
}

Preparation::Work::Work(Preparation& preparation, const FrameRequest* frame) : preparation_(preparation) {
  const std::lock_guard lock(preparation_.mutex_);
  ++preparation_.in_work_;
  if (preparation_.current_ && !(frame && *preparation_.current_ == moment_of(*frame))) preparation_.give_up_ = true;
}

Preparation::Work::~Work() {
  {
    const std::lock_guard lock(preparation_.mutex_);
    --preparation_.in_work_;
  }
  preparation_.changed_.notify_all();
}

Preparation::Track& Preparation::track_of(const FrameRequest& frame, std::string_view name) {
  const auto goes_on = [&](const Pose& last) {
    return (last.position_m - frame.pose.position_m).norm() <= kFarthestStep_m &&
           last.camera_from_moon.angularDistance(frame.pose.camera_from_moon) <= kWidestTurn_rad;
  };
  const auto found = std::find_if(tracks_.begin(), tracks_.end(), [&](const Track& track) {
    return track.name == name && track.last.camera == frame.camera && goes_on(track.last.pose);
  });
  if (found != tracks_.end()) {
    std::rotate(tracks_.begin(), found, found + 1);
  } else {
    tracks_.push_front({++next_track_, std::string(name), frame});
    if (tracks_.size() > kMostTracks) tracks_.pop_back();
  }
  return tracks_.front();
}

Preparation::Track* Preparation::find_track(const Expected& next) {
  const auto found = std::ranges::find(tracks_, next.track, &Track::number);
  return found == tracks_.end() || found->frame != next.frame ? nullptr : &*found;
}

void Preparation::forget_expected(std::uint64_t track) {
  std::erase_if(expected_, [&](const Expected& e) { return e.track == track; });
}

const Preparation::Ready* Preparation::Track::ready_for(const Moment& moment) const {
  const auto found = std::find_if(ready.begin(), ready.end(), [&](const Ready& r) { return r.moment == moment; });
  return found == ready.end() ? nullptr : &*found;
}

// Of what is ready that which is for these moments and still there. The soonest is asked for last: of what is kept on a
// budget, that which was used longest ago goes first.
void Preparation::keep_ready(Track& track, std::span<const Moment> moments) {
  std::vector<Ready> kept;
  for (auto moment = moments.rbegin(); moment != moments.rend(); ++moment)
    if (const Ready* ready = track.ready_for(*moment); ready && ready->still_there()) kept.push_back(*ready);
  track.ready = std::move(kept);
}

void Preparation::expect_at(Expected next) {
  const auto later =
      std::find_if(expected_.begin(), expected_.end(), [&](const Expected& e) { return e.step > next.step; });
  expected_.insert(later, std::move(next));
}

std::vector<Preparation::Moment> Preparation::moments_ahead(const FrameRequest& before, const FrameRequest& now,
                                                            std::span<const Pose> ahead) {
  const auto sun = [&](int steps) { return extrapolated(before.sun.direction, now.sun.direction, steps); };
  std::vector<Moment> moments;
  for (const Pose& pose : ahead) moments.push_back({pose, sun(static_cast<int>(moments.size()) + 1)});
  if (!ahead.empty()) return moments;
  const bool alike = (before.sun.direction - now.sun.direction).norm() <= kSlowSun_rad && !now.indirect.terrain;
  if (same(before.pose, now.pose) && (alike || sun(1) == now.sun.direction)) return moments;
  const std::span<const int> steps = now.detail || now.indirect.terrain ? std::span<const int>(kExtrapolatedFarther)
                                                                        : std::span<const int>(kExtrapolated);
  for (const int step : steps) moments.push_back({extrapolated(before.pose, now.pose, step), sun(step)});
  return moments;
}

void Preparation::expect(const FrameRequest& frame, std::span<const Pose> ahead, std::string_view name) {
  // Without memory or threads for it nothing is prepared; the frame has its answer all the same.
  try {
    const std::lock_guard lock(mutex_);
    if (stopping_) return;
    Track& track = track_of(frame, name);
    const FrameRequest before = std::exchange(track.last, frame);
    track.left = budget_;
    ++track.frame;
    forget_expected(track.number);
    const std::vector<Moment> moments = moments_ahead(before, frame, ahead);
    keep_ready(track, moments);
    for (std::size_t step = 0; step < moments.size(); ++step) {
      if (track.ready_for(moments[step])) continue;
      Expected next{track.number, track.frame, step, frame};
      next.request.pose = moments[step].pose, next.request.sun.direction = moments[step].sun;
      expect_at(std::move(next));
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

void Preparation::run() {
  using Clock = StopToken::Clock;
  std::unique_lock lock(mutex_);
  for (;;) {
    changed_.wait(lock, [&] { return stopping_ || (in_work_ == 0 && !expected_.empty()); });
    if (stopping_) return;
    const Expected next = std::move(expected_.front());
    expected_.pop_front();
    const Track* const track = find_track(next);
    const auto left = track ? track->left : Clock::duration::zero();
    current_ = moment_of(next.request);
    give_up_ = false;
    lock.unlock();
    const Clock::time_point start = Clock::now();
    const Outcome outcome = left > Clock::duration::zero() ? prepare(next, start + left) : Outcome::out_of_budget;
    const Clock::duration spent = Clock::now() - start;
    lock.lock();
    current_.reset();
    if (Track* const charged = find_track(next)) {
      charged->left -= spent;
      if (outcome == Outcome::given_up) try_again(next);
      if (outcome == Outcome::out_of_budget) forget_expected(next.track);
    }
    changed_.notify_all();
  }
}

Preparation::Outcome Preparation::prepare(const Expected& next, StopToken::Clock::time_point deadline) {
  try {
    remember(next, prepare_(next.request, StopToken(deadline, &give_up_)));
  } catch (const Cancelled&) {
    return give_up_ ? Outcome::given_up : Outcome::out_of_budget;
  } catch (const std::exception&) {
    // The frame will say so itself, if it is ever asked for.
  }
  return Outcome::done;
}

void Preparation::remember(const Expected& next, const StillThere& still_there) {
  const std::lock_guard lock(mutex_);
  for (Track& track : tracks_)
    if (track.number == next.track) track.ready.push_back({moment_of(next.request), still_there});
}

void Preparation::try_again(const Expected& next) {
  try {
    expected_.push_front(next);
  } catch (const std::exception&) {
    // Without memory for it there is no use in it.
  }
}

}  // namespace selenograph::engine
