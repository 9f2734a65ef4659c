#include "engine/visibility/frame_sources.h"

#include <algorithm>

#include "dem/error.h"

namespace selenograph::engine {

FrameSources::FrameSources(std::size_t catalogue_size)
    : number_plus_one_(std::make_unique<std::atomic<std::uint32_t>[]>(catalogue_size)) {}

std::uint32_t FrameSources::add(dem::SourceIndex source) {
  const std::lock_guard lock(mutex_);
  std::atomic<std::uint32_t>& number = number_plus_one_[source];
  if (number.load(std::memory_order_relaxed) == 0) {
    seen_.push_back(source);
    number.store(static_cast<std::uint32_t>(seen_.size()), std::memory_order_relaxed);
  }
  return number.load(std::memory_order_relaxed);
}

std::uint16_t FrameSources::product_number(dem::SourceIndex source) {
  const std::uint32_t number = this->number(source);
  if (number >= kNone) throw TooMuchTerrain("the frame sees more sources than its product 'source' can tell apart");
  return static_cast<std::uint16_t>(number);
}

std::vector<dem::SourceIndex> FrameSources::settle(std::vector<std::uint16_t>& product) const {
  std::vector<dem::SourceIndex> sorted = seen_;
  std::sort(sorted.begin(), sorted.end());
  std::vector<std::uint16_t> place(seen_.size());
  for (std::size_t i = 0; i < seen_.size(); ++i)
    place[i] = static_cast<std::uint16_t>(std::lower_bound(sorted.begin(), sorted.end(), seen_[i]) - sorted.begin());
  for (std::uint16_t& number : product)
    if (number != kNone) number = place[number];
  return sorted;
}

}  // namespace selenograph::engine
