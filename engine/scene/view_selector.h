// One attempt to select blocks at given targets (selection.h): blocks in view (view_selector.cpp), occluders
// (view_selector_shadows.cpp), and balancing of neighbours' levels (view_selector_balance.cpp).
//
// All traversals descend the quadtree from its roots. At each node:
//
//               +-- culled, out of view                            -> out_of_view_, later tested as occluders
//    visit(id) -+-- error within the target, or finest             -> visible_blocks_
//               +-- error above the target: children +-- plain     -> visit(child), at once
//                                                    +-- detailed  -> pending_detail_, made later in batches
//
// Threads traverse disjoint slices of the tree (QuadtreeSlice). Slices are merged in the tree's order, so the selection
// does not depend on the number of threads.
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
#include "engine/scene/bounded_nodes.h"
#include "engine/scene/expected_error.h"
#include "engine/scene/light_tree.h"
#include "engine/scene/root_groups.h"
#include "engine/scene/selected_blocks.h"

namespace selenograph::engine {

// Thrown if a frame would have too many blocks of detail.
struct TooMuchDetail {};

// Detail targets of this many pixels or more are no constraint.
inline constexpr double kNoTarget_px = 100;

class ViewSelector {
  using BlockId = dem::BlockId;
  using Chosen = std::unordered_set<BlockId, dem::BlockIdHash>;

 public:
  // The detail target is at least max_error_px.
  ViewSelector(const dem::Terrain& terrain, std::span<const ViewBundle> views, const Accuracy& accuracy,
               const SceneBudget& budget, const StopToken& stop, const std::vector<Ball>& receivers);

  // Returns true if targets may be relaxed until the detail fits.
  static bool can_relax(const Accuracy& accuracy) {
    return accuracy.max_error_px > 0 && accuracy.max_detail_error_px < kNoTarget_px;
  }

  Selection select(const Sun* sun);

  // Returns true if the shadow target has refined anything so far: a larger target then needs less terrain.
  bool refined_for_shadows() const { return refined_for_shadows_; }

 private:
  // Vertical errors of a block, m; 0 for the finest surface, to which errors are measured.
  struct Errors {
    double total_m = 0;
    double detail_m = 0;         // part of total_m that comes from detail
    double left_out_size_m = 0;  // largest detail that the block leaves out
    double highest_m = 0;        // greatest height of the block
  };

  // A block in view, or an occluder under evaluation.
  struct VisibleBlock {
    BlockId id;
    dem::NodeInfo info;
    NodeBounds bounds;
    double pixels_per_metre;
    bool is_finest = false;
    std::optional<Errors> errors{};  // empty if they would have to be built
  };
  VisibleBlock visible_block(const BlockId& id, const BoundedNode& node) const;

  // Throws TooMuchTerrain for more blocks than kMaxBlocks, Cancelled once `stop` is requested.
  static void check(std::size_t blocks, const StopToken& stop);

  // Outcome of culling: in view, out of view, or without data.
  enum class CullResult { in_view, out_of_view, no_data };

  // Result of culling a block; `visible` if it is in view.
  struct BlockView {
    CullResult cull = CullResult::no_data;
    std::optional<VisibleBlock> visible{};
    bool too_coarse = false;  // by its outline, so the block was not made
  };

  // Blocks that one slice of the quadtree adds to the selection.
  struct QuadtreeSlice {
    std::vector<VisibleBlock> visible;
    std::vector<BlockId> out_of_view, without_data, pending_detail;  // the last are yet to be made
    std::vector<std::pair<BlockId, float>> occluders;                // with their greatest height, m
    double shadow_error_px = 0;
    void record(const BlockId& id, CullResult cull);
    void append(QuadtreeSlice&& next);
  };
  // Adds a slice to the selection.
  void merge(QuadtreeSlice&& slice);
  // Calls visit_one(i, slice) for every i below count by all threads, and merges the slices in order. Throws as check()
  // does once all are merged.
  template <typename Visit>
  void visit_slices(std::size_t count, std::size_t grain, const Visit& visit_one) {
    std::vector<QuadtreeSlice> slices((count + grain - 1) / grain);
    unmerged_blocks_ = 0;
    in_parallel(slices.size(), [&](std::size_t s) {
      for (std::size_t i = s * grain; i < std::min((s + 1) * grain, count); ++i) visit_one(i, slices[s]);
    });
    for (QuadtreeSlice& slice : slices) merge(std::move(slice));
    check(chosen_.size() + visible_blocks_.size(), stop_);
  }
  // Abort a traversal early: in view at the limit, for occluders only at eight times the limit. The abort depends on
  // thread timing, but the result must not: relaxation depends on whether any occluder was refined.
  void count_block() const { check(++unmerged_blocks_, stop_); }
  void count_occluder() const { check(++unmerged_blocks_ / 8, stop_); }

  // Culls a block, and computes bounds and pixels per metre of one in view. Avoids building or making it where
  // possible.
  BlockView view_block(const BlockId& id) const;
  // Returns true if every block that fits this outline needs refinement.
  bool must_refine(const BlockId& id, const dem::NodeInfo& outline, const NodeBounds& bounds) const;
  static bool may_be_visible(const ViewBundle& view, const NodeBounds& b);
  bool may_be_visible(const NodeBounds& b) const;

  // Returns the maximum over the views in which the bounds may be visible.
  double pixels_per_metre(const NodeBounds& b) const;

  void visit_roots();
  // Accepts a block in view, or visits its children if it must be refined.
  void visit(const BlockId& id, QuadtreeSlice& slice) const;

  // Queues a block of detail for visit_detail(); one that is culled by its parent's height bounds is never made.
  void request_refinement(const BlockId& child, const dem::NodeInfo& parent, QuadtreeSlice& slice) const;

  // Processes blocks with detail in waves, one per level. A block is made on first access, which takes a millisecond,
  // by all threads. Batches detect too much detail (more than max_blocks) before it is made. Any thread calls
  // evaluate(id); one thread at a time calls commit(id, evaluation, next wave), in the order of the blocks.
  template <typename Evaluate, typename Commit>
  void in_waves(std::vector<BlockId> wave, std::size_t max_blocks, const Evaluate& evaluate, const Commit& commit) {
    constexpr std::size_t kBatch = 256;
    while (!wave.empty()) {
      std::vector<BlockId> next;
      for (std::size_t first = 0; first < wave.size(); first += kBatch) {
        const std::size_t pending = wave.size() - first + next.size();
        check(chosen_.size() + visible_blocks_.size() + pending, stop_);
        if (max_blocks != kUnlimited && detail_block_count_ + pending > max_blocks) throw TooMuchDetail();
        std::vector<std::invoke_result_t<Evaluate, const BlockId&>> evaluations(std::min(kBatch, wave.size() - first));
        in_parallel(evaluations.size(), [&](std::size_t i) {
          stop_.check();
          evaluations[i] = evaluate(wave[first + i]);
        });
        for (std::size_t i = 0; i < evaluations.size(); ++i) commit(wave[first + i], evaluations[i], next);
      }
      wave = std::move(next);
    }
  }

  void visit_detail();

  // Accepts a block in view or queues its children.
  void accept_block(const BlockId& id, const BlockView& block, bool must_refine, QuadtreeSlice slice,
                    std::vector<BlockId>& next);

  void add_visible(const VisibleBlock& block);
  void count_detail(const BlockId& id, std::ptrdiff_t change);

  bool is_finest(const BlockId& id) const { return id.level >= terrain_.finest_level(id); }

  static Errors errors_of(const BlockId& id, const dem::NodeInfo& info);
  Errors errors_of(const BlockId& id) const;
  Errors errors_of(const VisibleBlock& block) const { return block.errors ? *block.errors : errors_of(block.id); }
  // Returns the expected error, m: the bound for the posts, plus what the detail leaves out on 99 % of the ground.
  double expected_m(const Errors& errors) const;

  // Returns true if detail that a block leaves out would be visible by its shading (Accuracy::kSmallestShown).
  bool hides_visible_detail(const BlockId& id, const Errors& errors, double pixels_per_metre) const;

  // Returns the foreshortening of a size on the ground, as the mean over all directions on it: the root of the cosine
  // of the emission angle, in the view most from above.
  double foreshortening(const BlockId& id, double highest_m) const;
  bool needs_refinement(const VisibleBlock& block) const;

  // Returns true if the block's error exceeds the target.
  bool exceeds_target(const BlockId& id, const Errors& errors, double pixels_per_metre) const;

  void choose(const BlockId& id, float highest_m);

  // Upper limit of pixels per metre on objects: an object next to the camera does not require arbitrarily fine terrain.
  static constexpr double kMaxPixelsPerMetreOfObjects = 1;

  // Refines all terrain that can cast a shadow into view, in view or not, to the shadow target.
  void refine_for_shadows(const Sun& sun);

  // Shift of shadow edges by a block's error: an upper bound in pixels; too_large: expected above the target, and finer
  // posts would reduce it.
  struct ShadowShift {
    bool too_large = false;
    double bound_px = 0;
  };

  // Returns the shift of shadow edges by a height error: error_m times shift_px_per_m, which grows as the Sun sinks. As
  // level ground is a sphere, an error e shifts them by at most sqrt(2 R e), however low the Sun is.
  double shadow_shift_px(double error_m, double shift_px_per_m) const;
  // Returns the largest error that shifts shadow edges by no more than the target.
  double max_error_for_shadows_m(double shift_px_per_m) const;
  ShadowShift shadow_shift(const VisibleBlock& block, double shift_px_per_m) const;
  // Records a shift in the slice, or that the shadow target refines something. Returns true if it is too large.
  bool record_shift(const ShadowShift& shift, QuadtreeSlice& slice) const;
  void refine_for_shadows(const VisibleBlock& block, const LightTree& receivers, QuadtreeSlice& slice) const;
  void refine_detail_for_shadows(const LightTree& receivers);

  // Evaluation of a block outside the view.
  struct Occluder {
    bool matters = false, too_coarse = false;
    dem::NodeInfo info{};
    ShadowShift shift{};
  };

  Occluder evaluate_occluder(const BlockId& id, const LightTree& receivers) const;

  // Visits terrain out of view: adds an occluder, or visits its children if it is too coarse. Children with detail are
  // deferred.
  void visit_occluder(const BlockId& id, const LightTree& receivers, QuadtreeSlice& slice) const;

  static void request_occluder(const BlockId& child, const dem::NodeInfo& parent, const LightTree& receivers,
                               std::vector<BlockId>& pending);
  void visit_detail_occluders(std::vector<BlockId> wave, const LightTree& receivers);

  // Adds an occluder to the slice. Returns true if it must be refined instead.
  bool accept_occluder(const BlockId& id, const Occluder& evaluation, QuadtreeSlice& slice) const;

  // Computes the reported bounds over the blocks in view.
  void report();
  BlockError expected_error_of(const VisibleBlock& block, const Errors& errors) const;

  // Records terrain in view that is missing because of an unusable file.
  void record_void(const BlockId& id);

  void record_replaced(const BlockId& id);
  void record_replacements();

  // Returns the name of the setting that most of the terrain is selected for.
  const char* limiting_setting() const {
    return 2 * detail_block_count_ > chosen_.size() ? "max_detail_error_px" : "max_error_px";
  }

  void check_size() const;

  // Returns the chosen block that contains a position, at `level` or coarser; null if none does.
  const BlockId* covering(dem::Tick lat, dem::Tick lon, int level) const;

  // A position just outside the middle of a block's side or its corner; north and east are -1, 0 or 1.
  struct NeighbourProbe {
    dem::Tick lat, lon;
    int north, east;
  };
  template <typename Visit>
  static void for_each_neighbour(const BlockId& id, const Visit& visit) {
    const dem::BlockExtent e = dem::extent_of(id);
    const dem::Tick lats[]{e.lat0 - 1, (e.lat0 + e.lat1()) / 2, e.lat1()};
    const std::int64_t lons[]{std::int64_t{e.lon0} - 1, (std::int64_t{e.lon0} + e.lon1()) / 2, e.lon1()};
    for (int north = -1; north <= 1; ++north) {
      const dem::Tick lat = lats[north + 1];
      if (lat < 0 || lat >= dem::kLatTicks) continue;
      for (int east = -1; east <= 1; ++east)
        if (north != 0 || east != 0) visit(NeighbourProbe{lat, dem::wrap_lon(lons[east + 1]), north, east});
    }
  }

  // Returns true if the block's edge follows a coarser neighbour out of view while its quads may be in view. A
  // neighbour in view has bounds of its own.
  bool edge_follows(const BlockId& id, const BlockId& neighbour, const NeighbourProbe& at) const;

  // Returns true if a neighbour shows a coarser layer's posts unchanged beside those of a finer layer. Split, it would
  // be the same surface in more triangles.
  bool shows_coarser_layer(const BlockId& neighbour, const BlockId& id) const;

  bool must_split(const BlockId& neighbour, const BlockId& id, const NeighbourProbe& at) const;
  // Returns the neighbour at `at` that must be split beside the block; null: none.
  const BlockId* unbalanced_neighbour(const BlockId& id, const NeighbourProbe& at) const;

  void find_coarser_neighbours();
  // Returns whether a coarser block in view beside this one softens its normals.
  bool may_soften(const BlockId& id) const;
  // Returns the corners of a block with detail at which a coarser block is in view, with the full share.
  Corners corners_at_coarser(const BlockId& id) const;
  void spread(const std::vector<BlockId>& blocks, std::vector<Corners>& corners) const;

  // Splits blocks until levels of neighbours differ by at most one, beside a coarser layer's posts by at most
  // kMaxLevelsApart, so that edges join vertex by vertex, and until no edge in view exceeds the reported error.
  void balance();

  // Replaces a block by its children. Takes the id by value, because its set erases the original.
  void split(const BlockId id, std::vector<BlockId>& todo);

  const dem::Terrain& terrain_;
  std::span<const ViewBundle> views_;
  const Accuracy& accuracy_;
  SceneBudget budget_;
  const StopToken& stop_;
  const std::vector<Ball>& receivers_;
  static constexpr std::size_t kUnlimited = std::numeric_limits<std::size_t>::max();
  // Limits of blocks with detail, in all and in view: blocks in view leave some for occluders. Then their number so
  // far.
  std::size_t max_detail_blocks_ = kUnlimited, max_detail_in_view_ = kUnlimited, detail_block_count_ = 0;
  Chosen chosen_;
  mutable std::atomic<std::size_t> unmerged_blocks_ = 0;  // number of blocks in unmerged slices
  int coarsest_level_ = 0;                                // coarsest level of the chosen blocks before any is split
  std::vector<VisibleBlock> visible_blocks_;

  std::unordered_map<BlockId, double, dem::BlockIdHash>
      in_view_;  // pixels per metre of blocks in view, including children of split blocks
  std::vector<BlockId> out_of_view_, pending_detail_;  // the latter are yet to be made
  std::vector<const RootGroup*> groups_out_of_view_;

  mutable std::atomic<bool> refined_for_shadows_ = false;
  double max_receiver_pixels_per_metre_ = 0;  // largest pixels per metre of all receivers
  Selection result_;
};

}  // namespace selenograph::engine
