// A block of ground is made in four steps. Their order keeps its threads from deadlocking.
//
//   DetailedTerrain::block(id) --> find --hit--> return
//       | miss
//       v
//   plain_.node(..)          (1) wait for the pyramid of the posts, holding no slot: this may take seconds
//       v
//   where_loops_run          (2) take a slot of the task arena
//       v
//   get(Kind::block)         (3) single flight: the first thread makes the block, the others sleep in their slots
//       v
//   GroundMaker::block       (4) parallel loops of the maker, in the arena that it is already in
//
//   thread A: starts the flight  --waits for a slot-->  [slot 1: B asleep] [slot 2: C asleep]
//                  ^                                          |                 |
//                  +------------- wait for A's flight --------+-----------------+      deadlock, if (3) came before (2)
//
// Threads asleep in (3) occupy slots. A maker that started its flight before it had a slot could wait in (4) for a slot
// that such a sleeper holds. As (2) comes before (3), a maker always has a slot, and runs its loops alone if all other
// threads sleep. Loops are isolated (parallel.h): a maker that waits for the end of a loop does not start a task that
// would wait for the maker's own flight. Flights nest in one direction only, so they form no cycle: a block or an
// outline waits for mean_correction, this one for relief_factor, all of them for layer_posts and for blocks of the
// plain terrain, and none of these waits for a block. The pyramid's builder has an arena of its own: a maker that has
// to wait for a neighbour's pyramid is slow, not stuck.
#include "dem/detail/ground_cache.h"

#include <utility>

#include "dem/base/hash.h"
#include "dem/base/parallel.h"
#include "dem/terrain/block_store.h"

namespace selenograph::dem {
namespace {

// Version of the heights in the cache folder, which outlive an update of the software. Increment it with every change
// that alters a stored bit (GroundOnDisk.IsOfThisVersion in unit.block_store).
constexpr std::uint64_t kGroundVersion = 9;

std::uint64_t key_of_ground(const Catalogue& catalogue, const DetailPreset& preset) {
  const std::uint64_t parts[] = {kGroundVersion, catalogue.fingerprint(), preset.fingerprint};
  return hash_of(parts, sizeof parts);
}

}  // namespace

BlockId GroundCache::key_of(int number, Kind kind, const BlockId& id) {
  constexpr int kLevelStride = 32;
  static_assert(kMaxLevel < kLevelStride);
  constexpr int kKinds = 5;
  return {kLevelStride * (kKinds * number + static_cast<int>(kind)) + id.level, id.row, id.col};
}

GroundCache::GroundCache(const PyramidTerrain& plain, const DetailPreset& preset)
    : plain_(plain),
      number_(plain.new_detail_number()),
      storable_(preset.fingerprint != 0),
      disk_key_(key_of_ground(plain.catalogue(), preset)) {}

std::optional<std::shared_ptr<const Block>> GroundCache::find(Kind kind, const BlockId& id) const {
  return plain_.blocks().find(key_of(number_, kind, id));
}

std::shared_ptr<const Block> GroundCache::get(Kind kind, const BlockId& id, const StopToken& stop,
                                              const Make& make) const {
  return plain_.blocks().get(
      key_of(number_, kind, id),
      [&] {
        std::shared_ptr<const Block> value = make();
        const std::size_t bytes = value ? value->bytes() : sizeof(Block);
        return BlockCache::Loaded{std::move(value), bytes};
      },
      stop);
}

std::shared_ptr<const Block> GroundCache::run_in_arena(const std::optional<BlockId>& posts, const StopToken& stop,
                                                       const Make& make) const {
  if (posts) plain_.node(*posts, stop);
  std::shared_ptr<const Block> ground;
  where_loops_run([&] { ground = make(); });
  return ground;
}

std::shared_ptr<const Block> GroundCache::read_or_make(const BlockId& id, const Make& make) const {
  BlockStore* const store = plain_.block_store();
  // Bypass the cache folder while a coarser layer replaces an unusable file: the ground differs until it is repaired.
  if (!store || !storable_ || plain_.has_replacements()) return make();
  if (auto block = store->read(disk_key_, id)) return block;
  auto block = make();
  if (block && !plain_.has_replacements()) store->write(disk_key_, *block);
  return block;
}

}  // namespace selenograph::dem
