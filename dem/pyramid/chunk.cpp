#include "dem/pyramid/chunk.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <cerrno>
#include <cmath>
#include <cstring>
#include <filesystem>
#include <limits>
#include <optional>
#include <utility>

#include "dem/base/error.h"
#include "dem/base/hash.h"
#include "dem/files/open_file.h"
#include "dem/grid/shading_normals.h"
#include "dem/pyramid/block_posts.h"
#include "dem/pyramid/chunk_format.h"

namespace selenograph::dem {
namespace {

constexpr std::uint64_t kMaxHead_bytes = std::uint64_t{64} << 20;

std::string read_bytes(const OpenFile& file, std::uint64_t offset, std::uint64_t size) {
  std::string bytes(size, '\0');
  if (!file.read(offset, size, bytes.data())) throw DataError(file.path(), "truncated pyramid file");
  return bytes;
}

bool is_missing(int code) { return code == ENOENT || code == ENOTDIR || code == ELOOP || code == ENAMETOOLONG; }

// Returns the size of header, index and names. Throws DataError on impossible sizes, before any of them is used.
std::uint64_t head_bytes(const format::Header& header, std::uint64_t available, const std::string& name) {
  if (std::memcmp(header.magic, format::kMagic, sizeof format::kMagic) != 0)
    throw DataError(name, "not a pyramid file of this version");
  if (header.total_bytes != available)
    throw DataError(name, fmt::format("truncated pyramid file: {} of {} bytes", available, header.total_bytes));
  const std::uint64_t head =
      sizeof(format::Header) + std::uint64_t{header.records} * sizeof(Chunk::Record) + header.names_bytes;
  if (head > available || head > kMaxHead_bytes) throw DataError(name, "damaged pyramid file: impossible index");
  return head;
}

// Returns the header at the beginning of a file.
format::Header header_from(const std::string& bytes, const std::string& name) {
  if (bytes.size() < sizeof(format::Header)) throw DataError(name, "truncated pyramid file");
  format::Header header;
  std::memcpy(&header, bytes.data(), sizeof header);
  return header;
}

// Largest absolute height of a block: interpolation may exceed a raster's heights, as the absolute weights of the
// bicubic kernel add up to 25/16.
constexpr double kFarthestOfBlock_m = 2 * kFarthestHeight_m;

// Throws DataError unless heights, bounds and error are possible: selection and visibility rely on them, and shading on
// the halo. `with_halo`: the heights of the block and its halo.
void check_heights(const Block& block, const std::vector<float>& with_halo, const std::string& name) {
  const auto is_height = [](float h) { return std::abs(h) <= kFarthestOfBlock_m; };
  const bool heights =
      std::all_of(with_halo.begin(), with_halo.end(), [&](float h) { return std::isnan(h) || is_height(h); });
  const bool bounded = is_height(block.min_m) && is_height(block.max_m) &&
                       std::all_of(block.vertices.begin(), block.vertices.end(), [&](const Vertex& v) {
                         return std::isnan(v.height_m) || (v.height_m >= block.min_m && v.height_m <= block.max_m);
                       });
  if (!heights || !bounded || !(block.error_m >= 0 && std::isfinite(block.error_m)))
    throw DataError(name, "damaged pyramid file: impossible heights in block " + to_string(block.id));
}

}  // namespace

std::shared_ptr<const Chunk> Chunk::open(const std::string& path, const ChunkPlan& plan, const Catalogue& catalogue) {
  std::optional<OpenFile> file;
  try {
    file.emplace(path, O_RDONLY);
  } catch (const SystemFault& fault) {
    if (is_missing(fault.code())) return nullptr;
    throw;
  }
  auto chunk = std::make_shared<Chunk>();
  chunk->path_ = path;
  chunk->state_ = file->state();
  chunk->total_ = chunk->state_.bytes;
  const format::Header header =
      header_from(read_bytes(*file, 0, std::min<std::uint64_t>(chunk->total_, sizeof(format::Header))), path);
  chunk->parse(read_bytes(*file, 0, head_bytes(header, chunk->total_, path)), plan, catalogue);
  return chunk;
}

std::shared_ptr<const Chunk> Chunk::from_bytes(std::string bytes, const ChunkPlan& plan, const Catalogue& catalogue,
                                               std::vector<SourceIndex> replaced) {
  auto chunk = std::make_shared<Chunk>();
  chunk->bytes_ = std::move(bytes);
  chunk->replaced_ = std::move(replaced);
  chunk->total_ = chunk->bytes_.size();
  chunk->node_ = plan.node;
  const std::string name = chunk->name();
  const std::uint64_t head = head_bytes(header_from(chunk->bytes_, name), chunk->total_, name);
  chunk->parse(chunk->bytes_.substr(0, head), plan, catalogue);
  return chunk;
}

// Reads the index and the names of the source files. Throws DataError if the file is damaged or was made from others.
void Chunk::parse(const std::string& head, const ChunkPlan& plan, const Catalogue& catalogue) {
  node_ = plan.node;
  const std::string name = this->name();
  const format::Header header = header_from(head, name);
  const char* index = head.data() + sizeof header;
  if (format::checksum_of_head(header, std::string_view(head).substr(sizeof header)) != header.head_checksum)
    throw DataError(name, "damaged pyramid file: wrong checksum");
  if (header.fingerprint != plan.fingerprint || BlockId{header.level, header.row, header.col} != plan.node ||
      header.base_level != plan.base_level)
    throw DataError(name, "pyramid was made from other sources");
  if (!(header.quantisation_m >= 0 && std::isfinite(header.quantisation_m)))
    throw DataError(name, "damaged pyramid file: impossible quantisation");
  quantisation_m_ = header.quantisation_m;
  base_level_ = header.base_level;
  for (std::uint32_t i = 0; i < header.records; ++i) {
    Record record;
    std::memcpy(&record, index + i * sizeof record, sizeof record);
    if (record.offset > total_ || record.size > total_ - record.offset)
      throw DataError(name, "damaged pyramid file: impossible record");
    records_[{record.level, record.row, record.col}] = record;
  }
  const char* names = index + header.records * sizeof(Record);
  for (const char* end = names + header.names_bytes; names < end; names += std::strlen(names) + 1) {
    const auto found = catalogue.find(names);
    if (!found) throw DataError(name, "pyramid was made from other sources");
    catalogue_index_.push_back(*found);
  }
}

const Chunk::Record* Chunk::find(const BlockId& id) const {
  const auto found = records_.find(id);
  return found == records_.end() ? nullptr : &found->second;
}

// Returns bytes of the chunk, from memory or from its file, which is opened for each read.
std::string Chunk::read(std::uint64_t offset, std::uint64_t size) const {
  if (path_.empty()) return bytes_.substr(offset, size);
  try {
    return read_bytes(OpenFile(path_, O_RDONLY), offset, size);
  } catch (const SystemFault& fault) {
    if (is_missing(fault.code())) throw DataError(path_, "pyramid file was removed");
    throw;
  }
}

bool Chunk::current() const { return path_.empty() || file_state(path_) == state_; }

std::size_t Chunk::bytes() const {
  return sizeof(Chunk) + bytes_.capacity() + records_.size() * (sizeof(Record) + sizeof(BlockId) + 32);
}

std::string Chunk::name() const { return path_.empty() ? "pyramid " + to_string(node_) : path_; }

// Reads a block's stored heights with their halo, and sets the block's sources.
std::vector<float> Chunk::read_stored(const Record& record, Block& block) const {
  const std::string bytes = read(record.offset, record.size);
  if (hash_of(bytes.data(), bytes.size()) != record.checksum)
    throw DataError(name(), "damaged pyramid file: wrong checksum of block " + to_string(block.id));
  const auto side = static_cast<std::size_t>(block.side()), wide = side + 2 * kHalo;
  const bool steps = record.flags & Record::kSteps;
  const std::size_t heights_bytes = wide * wide * (steps ? 2 : 4);
  const auto impossible_size = [&] {
    return DataError(name(), "damaged pyramid file: impossible size of block " + to_string(block.id));
  };
  if (bytes.size() < heights_bytes || (bytes.size() - heights_bytes) % sizeof(format::Run) != 0)
    throw impossible_size();
  std::vector<float> heights(wide * wide);
  if (steps) {
    const auto step = static_cast<float>(format::height_step_m(block.id.level));
    std::vector<std::uint16_t> raw(wide * wide);
    std::memcpy(raw.data(), bytes.data(), heights_bytes);
    for (std::size_t i = 0; i < raw.size(); ++i)
      heights[i] = raw[i] == format::kVoidSteps ? kNoHeight_m : record.lowest_m + static_cast<float>(raw[i]) * step;
  } else {
    std::memcpy(heights.data(), bytes.data(), heights_bytes);
  }
  std::vector<format::Run> runs((bytes.size() - heights_bytes) / sizeof(format::Run));
  std::memcpy(runs.data(), bytes.data() + heights_bytes, bytes.size() - heights_bytes);
  std::size_t posts = 0;
  for (format::Run& run : runs) {
    posts += run.posts;
    const SourceIndex index = source_of(run.mark);
    if (index == kNoSource) {
      run.mark = kNoSource;  // earlier versions wrote another number
      continue;
    }
    if (index >= catalogue_index_.size())
      throw DataError(name(), "damaged pyramid file: a source that it does not name");
    run.mark = (run.mark & kMarkBits) | catalogue_index_[index];
  }
  if (posts != side * side) throw impossible_size();
  if (runs.size() == 1) runs[0].posts = 1;
  for (const format::Run& run : runs) block.sources.insert(block.sources.end(), run.posts, run.mark);
  return heights;
}

// Composes a block of posts from its files, or decodes a filtered one; then computes its normals.
std::shared_ptr<const Block> Chunk::load(const BlockId& id, const PostSource& source, const StopToken& stop) const {
  const Record* record = find(id);
  if (!record || (record->flags & Record::kEmpty)) return nullptr;
  auto block = empty_block(id, extent_of(id));
  block->error_m = record->error_m;
  block->min_m = record->min_m;
  block->max_m = record->max_m;
  const bool from_sources = record->flags & Record::kFromSources;
  std::vector<float> heights;
  if (from_sources) {
    PostsOfBlock posts = compose_block(node_, id, source, stop);
    if (!std::includes(replaced_.begin(), replaced_.end(), posts.replaced.begin(), posts.replaced.end()))
      throw OtherSources(name(),
                         "was made when " + std::to_string(posts.replaced.size()) + " more of its files could be used");
    heights = std::move(posts.heights);
    block->sources = std::move(posts.sources);
    block->pack();
  } else {
    heights = read_stored(*record, *block);
  }
  const auto side = static_cast<std::size_t>(block->side()), wide = side + 2 * kHalo;
  block->vertices.resize(side * side);
  for (std::size_t r = 0; r < side; ++r)
    for (std::size_t c = 0; c < side; ++c)
      block->vertices[r * side + c].height_m = heights[(r + kHalo) * wide + kHalo + c];
  try {
    check_heights(*block, heights, name());
  } catch (const DataError& error) {
    if (from_sources) throw OtherSources(name(), "was made from other posts of block " + to_string(id));
    throw;
  }
  fill_shading_normals(*block, heights, {.filtered = id.level < base_level_, .quantisation_m = quantisation_m_});
  return block;
}

}  // namespace selenograph::dem
