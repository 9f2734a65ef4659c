// Implementation of selection.h: blocks in view, as fine as needed (view_selector.cpp); shadow casters
// (view_selector_shadows.cpp); balancing, so that levels of neighbours differ by at most one
// (view_selector_balance.cpp).
#pragma once

#include <algorithm>
#include <atomic>
#include <cstddef>
#include <limits>
#include <optional>
#include <span>
#include <type_traits>
#include <unordered_map>
#include <unordered_set>
#include <utility>
#include <vector>

#include "dem/base/parallel.h"
#include "engine/camera/row_views.h"
#include "engine/frame/accuracy.h"
#include "engine/frame/sun.h"
#include "engine/scene/expected_error.h"
#include "engine/scene/known_nodes.h"
#include "engine/scene/light_tree.h"
#include "engine/scene/root_groups.h"
#include "engine/scene/selected_blocks.h"

namespace selenograph::engine {

// Thrown when there are more blocks of detail than a frame may have.
struct TooMuchDetail {};

// A detail target of this many pixels or more is no constraint.
inline constexpr double kNoAim_px = 100;

class ViewSelector {
  using BlockId = dem::BlockId;
  using Chosen = std::unordered_set<BlockId, dem::BlockIdHash>;

 public:
  // The detail target is at least max_error_px.
  ViewSelector(const dem::Terrain& terrain, std::span<const ViewBundle> views, const Accuracy& accuracy,
               const SceneRoom& room, const StopToken& stop, const std::vector<Ball>& receivers);

  static bool gives_way(const Accuracy& accuracy) {
    return accuracy.max_error_px > 0 && accuracy.max_detail_error_px < kNoAim_px;
  }

  Selection select(const Sun* sun);

  // Whether the shadow target has refined anything so far: if so, a larger target needs less terrain.
  bool refined_for_shadows() const { return refined_for_shadows_; }

 private:
  // Vertical error of a block, and of its detail; 0 for the finest surface, to which errors are measured. The largest
  // detail that it leaves out; its greatest height.
  struct Errors {
    double all_m = 0, of_detail_m = 0, left_out_size_m = 0, highest_m = 0;
  };

  struct Seen {
    BlockId id;
    dem::NodeInfo info;
    NodeBounds bounds;
    double pixels_per_metre;
    bool finest = false;
    std::optional<Errors> errors{};  // unless they would have to be built
  };
  Seen seen_of(const BlockId& id, const Known& node) const;

  // Throws TooMuchTerrain for more blocks than kMaxBlocks, Cancelled when it is stopped.
  static void check(std::size_t blocks, const StopToken& stop);

  enum class Look { in_view, out_of_view, nothing };

  struct Looked {
    Look look = Look::nothing;
    std::optional<Seen> seen{};
    bool too_coarse = false;  // by its outline: it was not made
  };

  // What a part of the terrain adds to the selection. Parts are found by all threads and joined in their order: the
  // selection does not depend on the threads.
  struct Part {
    std::vector<Seen> seen;
    std::vector<BlockId> out_of_view, nothing, of_detail;  // the last are yet to be processed
    std::vector<std::pair<BlockId, float>> casters;        // with their greatest height
    double shadow_error_px = 0;
    void note(const BlockId& id, Look look);
    void append(Part&& next);
  };
  void take(Part&& part);
  // Takes what make(i, part) adds for every i below count. Throws as check() does, when all is known.
  template <typename Make>
  void take_all(std::size_t count, std::size_t grain, const Make& make) {
    std::vector<Part> parts((count + grain - 1) / grain);
    blocks_ = 0;
    in_parallel(parts.size(), [&](std::size_t p) {
      for (std::size_t i = p * grain; i < std::min((p + 1) * grain, count); ++i) make(i, parts[p]);
    });
    for (Part& part : parts) take(std::move(part));
    check(chosen_.size() + seen_.size(), stop_);
  }
  // Of a part: too many in view are not waited for. Of casters only far too many: whether some were refined, which
  // decides what happens then, must not depend on which came first.
  void count_block() const { check(++blocks_, stop_); }
  void count_caster() const { check(++blocks_ / 8, stop_); }

  Looked looked_at(const BlockId& id) const;
  // Whether refine() is true of any block within such an outline.
  bool surely_refined(const BlockId& id, const dem::NodeInfo& outline, const NodeBounds& bounds) const;
  static bool may_see(const ViewBundle& view, const NodeBounds& b);
  bool may_see(const NodeBounds& b) const;

  // Maximum over the views that may see it.
  double pixels_per_metre(const NodeBounds& b) const;

  void see_roots();
  void see(const BlockId& id, Part& part) const;

  // Adds a block of detail unless it is out of view by its parent's height bounds: then it need not be made.
  void want_detail(const BlockId& child, const dem::NodeInfo& parent, Part& part) const;

  // Processes blocks with detail, which are made on first access, a millisecond each, by all threads. The work is done
  // in waves of pieces, so that too much detail (more blocks than `most`) is noticed before it is made; the result
  // depends on the blocks only, not on the threads. judge(id) is called by any thread; take(id, judged, next wave) by
  // one at a time.
  template <typename Judge, typename Take>
  void in_waves(std::vector<BlockId> wave, std::size_t most, const Judge& judge, const Take& take) {
    constexpr std::size_t kPiece = 256;
    while (!wave.empty()) {
      std::vector<BlockId> next;
      for (std::size_t first = 0; first < wave.size(); first += kPiece) {
        const std::size_t wanted = wave.size() - first + next.size();
        check(chosen_.size() + seen_.size() + wanted, stop_);
        if (most != kAny && of_detail_ + wanted > most) throw TooMuchDetail();
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

  // Takes a block in view; its children follow if it must be refined.
  void take_detail(const BlockId& id, const Looked& looked, bool finer, Part part, std::vector<BlockId>& next);

  void add_seen(const Seen& seen);
  void count_detail(const BlockId& id, std::ptrdiff_t change);

  bool finest(const BlockId& id) const { return id.level >= terrain_.finest_level(id); }

  static Errors errors_of(const BlockId& id, const dem::NodeInfo& info);
  Errors errors_of(const BlockId& id) const;
  Errors errors_of(const Seen& seen) const { return seen.errors ? *seen.errors : errors_of(seen.id); }

  // Whether detail that a block leaves out would be seen by its shading (Accuracy::kSmallestShown).
  bool shades_otherwise(const BlockId& id, const Errors& errors, double pixels_per_metre) const;

  // How much a size on the ground is foreshortened, as the mean over all directions on it: the root of the cosine of
  // the emission angle, of the view that sees the block most from above.
  double foreshortening(const BlockId& id, double highest_m) const;
  bool refine(const Seen& seen) const;

  // Whether the block's error exceeds the limit.
  bool errs(const BlockId& id, const Errors& errors, double pixels_per_metre) const;

  void choose(const BlockId& id, float highest_m);

  // Upper limit on pixels per metre: an object next to the camera does not require arbitrarily fine terrain.
  static constexpr double kSharpest = 1;

  // Refines terrain that can cast a shadow into view, whether it is in view or not.
  void sharpen_shadows(const Sun& sun);

  // Displacement of shadow edges by a block's error, pixels; whether it is too large and finer posts would reduce it.
  struct Blur {
    bool too_much = false;
    double displaced_px = 0;
  };

  // Returns how far a height error moves shadow edges: by `displaced_pixels_per_metre`, which grows as the Sun sinks.
  // As level ground is a sphere, an error e moves them by at most sqrt(2 R e), however low the Sun is.
  double displaced_px(double error_m, double displaced_pixels_per_metre) const;
  // Returns the largest error that moves shadow edges by no more than the target.
  double error_for_shadows_m(double displaced_pixels_per_metre) const;
  Blur blur(const Seen& seen, double displaced_pixels_per_metre) const;
  bool too_much(const Blur& blur, Part& part) const;
  void sharpen(const Seen& seen, const LightTree& receivers, Part& part) const;
  void sharpen_detail(const LightTree& receivers);

  // A caster outside the view.
  struct Caster {
    bool matters = false, too_coarse = false;
    dem::NodeInfo info{};
    Blur blur{};
  };

  Caster caster(const BlockId& id, const LightTree& receivers) const;

  // Adds a caster, or its children if it is too coarse; those with detail are deferred.
  void cast(const BlockId& id, const LightTree& receivers, Part& part) const;

  static void want_caster(const BlockId& child, const dem::NodeInfo& parent, const LightTree& receivers,
                          std::vector<BlockId>& wanted);
  void cast_detail(std::vector<BlockId> wave, const LightTree& receivers);

  // Returns whether it must be refined.
  bool take_caster(const BlockId& id, const Caster& caster, Part& part) const;

  // Computes the reported bounds over the blocks in view.
  void report();
  BlockError expected_of(const Seen& seen, double bound_m, const Errors& errors) const;

  // Notes terrain in view that is missing because of an unusable file.
  void note_void(const BlockId& id);

  void note_replaced(const BlockId& id);
  void note_replacements();

  // Name of the setting that most of the terrain is selected for.
  const char* wanting() const { return 2 * of_detail_ > chosen_.size() ? "max_detail_error_px" : "max_error_px"; }

  void check_size() const;

  // The chosen block that contains a place, at `level` or coarser.
  const BlockId* covering(std::int32_t lat, std::int32_t lon, int level) const;

  // Just outside the middle of a block's side, or a corner: -1, 0 or 1 to the north and to the east.
  struct Beside {
    std::int32_t lat, lon;
    int north, east;
  };
  template <typename Visit>
  static void around(const BlockId& id, const Visit& visit) {
    const dem::BlockExtent e = dem::extent_of(id);
    const std::int32_t lats[]{e.lat0 - 1, (e.lat0 + e.lat1()) / 2, e.lat1()};
    const std::int64_t lons[]{std::int64_t{e.lon0} - 1, (std::int64_t{e.lon0} + e.lon1()) / 2, e.lon1()};
    for (int north = -1; north <= 1; ++north) {
      const std::int32_t lat = lats[north + 1];
      if (lat < 0 || lat >= dem::kLatTicks) continue;
      for (int east = -1; east <= 1; ++east)
        if (north != 0 || east != 0) visit(Beside{lat, dem::wrap_lon(lons[east + 1]), north, east});
    }
  }

  // Whether a joined edge follows a coarser neighbour that is out of view, where the quads along it may be seen. (A
  // neighbour in view has its own bounds.)
  bool follows(const BlockId& id, const BlockId& neighbour, const Beside& at) const;

  // Whether a block shows a coarser layer's posts as they are, beside those of a finer layer: split it would be the
  // same surface, in more triangles.
  bool of_coarser_layer(const BlockId& neighbour, const BlockId& id) const;

  bool must_split(const BlockId& neighbour, const BlockId& id, const Beside& at) const;
  bool must_split_any(const BlockId& id) const;

  void find_coarser_beside();
  // Corners of a block with detail at which a coarser block is in view.
  Corners coarser_beside(const BlockId& id) const;

  // Splits blocks until levels of neighbours differ by at most one, beside a coarser layer's posts by at most five, so
  // that edges join vertex by vertex, and until no edge in view exceeds the promised error.
  void balance();

  // Takes the id by value: it is removed from the set that holds it.
  void split(const BlockId id, std::vector<BlockId>& todo);

  const dem::Terrain& terrain_;
  std::span<const ViewBundle> views_;
  const Accuracy& accuracy_;
  SceneRoom room_;
  const StopToken& stop_;
  const std::vector<Ball>& receivers_;
  static constexpr std::size_t kAny = std::numeric_limits<std::size_t>::max();
  // Blocks finer than the posts; those in view leave some for casters.
  std::size_t most_of_detail_ = kAny, most_in_view_ = kAny, of_detail_ = 0;
  Chosen chosen_;
  mutable std::atomic<std::size_t> blocks_ = 0;  // in parts
  int coarsest_ = 0;                             // level of those chosen, before any is split
  std::vector<Seen> seen_;

  std::unordered_map<BlockId, double, dem::BlockIdHash> in_view_;  // pixels per metre; includes parts of split blocks
  std::vector<BlockId> out_of_view_, of_detail_in_view_;           // the latter are yet to be processed
  std::vector<const RootGroup*> groups_out_of_view_;

  mutable std::atomic<bool> refined_for_shadows_ = false;
  double receivers_pixels_per_metre_ = 0;  // largest of what receives shadows
  Selection result_;
};

}  // namespace selenograph::engine
