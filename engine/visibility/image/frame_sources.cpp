#include "engine/visibility/image/frame_sources.h"

#include <fmt/format.h>

#include <algorithm>
#include <string>

#include "dem/base/error.h"
#include "dem/base/hash.h"

namespace selenograph::engine {

SourceTile source_tile(const dem::RasterInfo& info) {
  const std::string identity = fmt::format("{}:{:016x}", info.name, info.stamp);
  return {info.name, info.path, dem::hash_of(identity.data(), identity.size())};
}

FrameSources::FrameSources(std::size_t catalogue_size)
    : pages_(std::make_unique<std::atomic<Page*>[]>((catalogue_size + kPage - 1) / kPage)) {}

// Returns the number of a source plus one, and gives it the next number if it has none. Readers take no lock: they see
// a page or a number only once it is stored.
std::uint32_t FrameSources::add(dem::SourceIndex source) {
  const std::lock_guard lock(mutex_);
  std::atomic<Page*>& page = pages_[source / kPage];
  if (!page.load(std::memory_order_relaxed)) {
    owned_pages_.push_back(std::make_unique<Page>());
    page.store(owned_pages_.back().get(), std::memory_order_release);
  }
  std::atomic<std::uint32_t>& number = (*page.load(std::memory_order_relaxed))[source % kPage];
  if (number.load(std::memory_order_relaxed) == 0) {
    sources_.push_back(source);
    number.store(static_cast<std::uint32_t>(sources_.size()), std::memory_order_relaxed);
  }
  return number.load(std::memory_order_relaxed);
}

std::uint16_t FrameSources::product_number(dem::SourceIndex source) {
  const std::uint32_t number = this->number(source);
  if (number >= kNone) throw TooMuchTerrain("the frame sees more sources than its product 'source' can tell apart");
  return static_cast<std::uint16_t>(number);
}

std::vector<dem::SourceIndex> FrameSources::resolve(std::vector<std::uint16_t>& product) const {
  std::vector<dem::SourceIndex> sorted = sources_;
  std::sort(sorted.begin(), sorted.end());
  std::vector<std::uint16_t> index_of_number(sources_.size());
  for (std::size_t i = 0; i < sources_.size(); ++i)
    index_of_number[i] =
        static_cast<std::uint16_t>(std::lower_bound(sorted.begin(), sorted.end(), sources_[i]) - sorted.begin());
  for (std::uint16_t& number : product)
    if (number != kNone) number = index_of_number[number];
  return sorted;
}

}  // namespace selenograph::engine
