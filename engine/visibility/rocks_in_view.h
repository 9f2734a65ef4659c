// Which rocks of a detail a frame shows: those that are large enough in it, in view or with their shadow.
#pragma once

#include <map>
#include <optional>
#include <utility>
#include <vector>

#include "dem/detail/rocks_on_ground.h"
#include "dem/stop_token.h"
#include "dem/terrain.h"
#include "engine/camera/row_views.h"
#include "engine/frame/sun.h"

namespace selenograph::engine {

struct RocksInView {
  std::vector<dem::RockFeature> rocks;  // the largest first
  double least_px = 0;                  // diameter of the smallest, where the camera is nearest
};

// Rocks are shown from a diameter of 2 max_error_px pixels on, so that what is left out is no higher than the mesh's
// error may be; and from kLeastRock_px on at least. Where that were more than kMostRocks, the diameter is doubled until
// it isn't. `blocks`: that the frame is made of.
inline constexpr double kLeastRock_px = 0.5;
inline constexpr std::size_t kMostRocks = 32768;
RocksInView rocks_in_view(const dem::Terrain& terrain, const RowViews& views, const Sun* sun,
                          const std::vector<dem::BlockId>& blocks, double max_error_px, const StopToken& stop);

// Of terrain with rocks: all that lie in blocks, or reach into them. It remembers those that were asked for.
class RocksOnBlocks {
 public:
  explicit RocksOnBlocks(const dem::Terrain& terrain) : survey_(terrain) {}

  double largest_m() const { return survey_.field().law().largest_m; }
  // The largest first; nothing where they were more than kMost.
  std::optional<std::vector<dem::RockFeature>> on(const std::vector<dem::BlockId>& blocks, const StopToken& stop);
  static constexpr std::size_t kMost = 60000;

 private:
  using Piece = std::pair<int, dem::BlockId>;  // of an octave
  static constexpr std::size_t kMostRemembered = 500000;
  dem::RockSurvey survey_;
  std::map<Piece, std::vector<dem::RockFeature>> found_;
  std::size_t remembered_ = 0;
};

}  // namespace selenograph::engine
