// How selection.h chooses the blocks of a frame: what is in view, as fine as it has to be (view_selector.cpp); what
// casts shadows into view (view_selector_shadows.cpp); neighbours whose levels differ by at most one
// (view_selector_balance.cpp).
#pragma once

#include <algorithm>
#include <cstddef>
#include <limits>
#include <optional>
#include <span>
#include <type_traits>
#include <unordered_map>
#include <unordered_set>
#include <utility>
#include <vector>

#include "dem/support/parallel.h"
#include "engine/camera/row_views.h"
#include "engine/frame/accuracy.h"
#include "engine/frame/sun.h"
#include "engine/scene/known_nodes.h"
#include "engine/scene/light_tree.h"
#include "engine/scene/root_groups.h"
#include "engine/scene/selected_blocks.h"

namespace selenograph::engine {

// Of blocks finer than the posts there are more than a frame has use for.
struct TooMuchDetail {};

// An aim for detail of a hundred pixels and more is none.
inline constexpr double kNoAim_px = 100;

class ViewSelector {
  using BlockId = dem::BlockId;
  using Chosen = std::unordered_set<BlockId, dem::BlockIdHash>;

 public:
  // The aim for detail is max_error_px at least.
  ViewSelector(const dem::Terrain& terrain, std::span<const ViewBundle> views, const Accuracy& accuracy,
               const SceneRoom& room, const StopToken& stop, const std::vector<Ball>& receivers);

  static bool gives_way(const Accuracy& accuracy) {
    return accuracy.max_error_px > 0 && accuracy.max_detail_error_px < kNoAim_px;
  }

  Selection select(const Sun* sun);

  // Whether the aim for shadows has made anything finer, as far as select() came: a larger one takes less terrain then.
  bool refined_for_shadows() const { return refined_for_shadows_; }

 private:
  struct Seen {
    BlockId id;
    dem::NodeInfo info;
    NodeBounds bounds;
    double pixels_per_metre;
  };

  // Throws TooMuchTerrain for more blocks than kMaxBlocks, Cancelled when it is stopped.
  static void check(std::size_t blocks, const StopToken& stop);

  enum class Look { in_view, out_of_view, nothing };

  struct Looked {
    Look look = Look::nothing;
    std::optional<Seen> seen{};
  };

  Looked looked_at(const BlockId& id) const;
  std::optional<Seen> look_at(const BlockId& id);
  void note(const BlockId& id, Look look);
  static bool may_see(const ViewBundle& view, const NodeBounds& b);
  bool may_see(const NodeBounds& b) const;

  // The largest of the views that may see it.
  double pixels_per_metre(const NodeBounds& b) const;

  void see_roots();
  void see(const BlockId& id);

  // A block is as high as what it is part of: one that would be out of view even so needn't be made.
  void want_detail(const BlockId& child, const dem::NodeInfo& parent, std::vector<BlockId>& wanted);

  // Blocks with detail are made when they are first looked at, a millisecond each: by all threads. In waves, and those
  // in pieces, so that what is too much is found out before it is made. That is a matter of the blocks alone, not of
  // the threads. judge(id), by any thread; take(id, judged, next wave), one after the other.
  template <typename Judge, typename Take>
  void in_waves(std::vector<BlockId> wave, const Judge& judge, const Take& take) {
    constexpr std::size_t kPiece = 256;
    while (!wave.empty()) {
      std::vector<BlockId> next;
      for (std::size_t first = 0; first < wave.size(); first += kPiece) {
        const std::size_t wanted = wave.size() - first + next.size();
        check(chosen_.size() + seen_.size() + wanted, stop_);
        if (most_of_detail_ != kAny && of_detail_ + wanted > most_of_detail_) throw TooMuchDetail();
        std::vector<std::invoke_result_t<Judge, const BlockId&>> judged(std::min(kPiece, wave.size() - first));
        in_parallel(judged.size(), [&](std::size_t i) {
          stop_.check();
          judged[i] = judge(wave[first + i]);
        });
        for (std::size_t i = 0; i < judged.size(); ++i) take(wave[first + i], judged[i], next);
      }
      wave = std::move(next);
    }
  }

  void see_detail();

  // Of what is in view its children are next where it has to be finer.
  void take_detail(const BlockId& id, const Looked& looked, bool finer, std::vector<BlockId>& next);

  void add_seen(const Seen& seen);
  void count_detail(const BlockId& id, std::ptrdiff_t change);

  bool finest(const BlockId& id) const { return id.level >= terrain_.finest_level(id); }

  // The finest surface is what errors are measured to: it has none.
  double error_m(const BlockId& id) const;

  double detail_error_m(const BlockId& id) const;
  bool refine(const BlockId& id, double pixels_per_metre) const;

  // More than it may, as the finest surface has it.
  bool errs(const BlockId& id, double pixels_per_metre) const;

  void choose(const BlockId& id, const dem::NodeInfo& info);

  // Pixels per metre: an object next to the camera doesn't ask for terrain finer than there is.
  static constexpr double kSharpest = 1;

  // Refines what can cast a shadow into view, in view itself or not.
  void sharpen_shadows(const Sun& sun);

  // What a block's error does to shadow edges, pixels; whether that is too much and finer posts would help.
  struct Blur {
    bool too_much = false;
    double displaced_px = 0;
  };

  Blur blur(const BlockId& id, double displaced_pixels_per_metre) const;
  bool too_much(const Blur& blur);
  void sharpen(const Seen& seen, const LightTree& receivers);
  void sharpen_detail(const LightTree& receivers);

  // What casts shadows into view from outside of it.
  struct Caster {
    bool matters = false, too_coarse = false;
    dem::NodeInfo info{};
    Blur blur{};
  };

  Caster caster(const BlockId& id, const LightTree& receivers) const;

  // Of what is too coarse, the children: those with detail are for later.
  void cast(const BlockId& id, const LightTree& receivers, std::vector<BlockId>& of_detail);

  static void want_caster(const BlockId& child, const dem::NodeInfo& parent, const LightTree& receivers,
                          std::vector<BlockId>& wanted);
  void cast_detail(std::vector<BlockId> wave, const LightTree& receivers);

  // Whether it has to be finer.
  bool take_caster(const BlockId& id, const Caster& caster);

  // Bounds over what is in view.
  void report();

  // Something in view that an unusable file alone would have filled is not among the blocks, but lacks it.
  void note_void(const BlockId& id);

  void note_replaced(const BlockId& id);
  void note_replacements();

  // What most of the terrain is there for.
  const char* wanting() const { return 2 * of_detail_ > chosen_.size() ? "max_detail_error_px" : "max_error_px"; }

  void check_size() const;

  // The chosen block that holds a place, at `level` or coarser.
  const BlockId* covering(std::int32_t lat, std::int32_t lon, int level) const;

  // visit(latitude, longitude) just outside of each side's middle and of each corner.
  template <typename Visit>
  static void around(const BlockId& id, const Visit& visit) {
    const dem::BlockExtent e = dem::extent_of(id);
    const std::int64_t south = e.lat0 - 1, north = e.lat1(), west = std::int64_t{e.lon0} - 1, east = e.lon1();
    const std::int64_t mid_lat = (e.lat0 + e.lat1()) / 2, mid_lon = (std::int64_t{e.lon0} + e.lon1()) / 2;
    for (const std::int64_t lat : {south, mid_lat, north}) {
      if (lat < 0 || lat >= dem::kLatTicks) continue;
      for (const std::int64_t lon : {west, mid_lon, east})
        if (lat != mid_lat || lon != mid_lon) visit(static_cast<std::int32_t>(lat), dem::wrap_lon(lon));
    }
  }

  // Whether a joined edge follows a coarser neighbour out of view. (One in view has bounds of its own.)
  bool follows(const BlockId& id, const BlockId& neighbour) const;

  bool must_split(const BlockId& neighbour, const BlockId& id) const;

  // Splits blocks until neighbours differ by at most one level, so that edges join vertex by vertex, and until no edge
  // in view is worse than what is promised.
  void balance();

  // By value: the block is on its way out of the set that holds it.
  void split(const BlockId id, std::vector<BlockId>& todo);

  const dem::Terrain& terrain_;
  std::span<const ViewBundle> views_;
  const Accuracy& accuracy_;
  SceneRoom room_;
  const StopToken& stop_;
  const std::vector<Ball>& receivers_;
  static constexpr std::size_t kAny = std::numeric_limits<std::size_t>::max();
  std::size_t most_of_detail_ = kAny, of_detail_ = 0;  // blocks finer than the posts
  Chosen chosen_;
  std::vector<Seen> seen_;

  std::unordered_map<BlockId, double, dem::BlockIdHash> in_view_;  // pixels per metre; parts of what was split, too
  std::vector<BlockId> out_of_view_, of_detail_in_view_;           // the latter are still to be looked at
  std::vector<const RootGroup*> groups_out_of_view_;

  bool refined_for_shadows_ = false;
  Selection result_;
};

}  // namespace selenograph::engine
