// Times of indirect light.
#pragma once

namespace selenograph::engine {

// Elapsed time of the parts of indirect light at posts. All but the first run in parallel: each one's is its share of
// the threads' time.
struct LightTimes {
  double relief_ms = 0;   // heights of the ground around the posts
  double views_ms = 0;    // marches for the ground that the posts see
  double sunlit_ms = 0;   // sunlight on that ground
  double bounces_ms = 0;  // light of earlier bounces on that ground, with all that it takes
  double gather_ms = 0;   // the ground's light at the posts, and the Earth's

  LightTimes& operator+=(const LightTimes& t) {
    relief_ms += t.relief_ms;
    views_ms += t.views_ms;
    sunlit_ms += t.sunlit_ms;
    bounces_ms += t.bounces_ms;
    gather_ms += t.gather_ms;
    return *this;
  }
};

}  // namespace selenograph::engine
