// A pyramid file. The input is read as it is (its checksums are hardly ever right) and once more with everything made
// right that keeps a damaged file from the parser behind: magic, sizes, plan and checksums.

#include <algorithm>
#include <cstring>
#include <string>
#include <vector>

#include "dem/base/error.h"
#include "dem/base/hash.h"
#include "dem/catalogue/catalogue.h"
#include "dem/pyramid/chunk.h"
#include "dem/pyramid/chunk_format.h"
#include "tests/fuzz/fuzz.h"

namespace selenograph::fuzz {
namespace {

using namespace dem;
using format::Header;

const Catalogue& catalogue() {
  static const Catalogue two = [] {
    RasterInfo a, b;
    a.path = "a.lbl", b.path = "b.lbl";
    for (RasterInfo* far_away : {&a, &b}) {
      far_away->width = far_away->height = 4;
      set_grid(*far_away, GeographicGrid{70, 100, 16, 16});
    }
    return Catalogue(std::vector<RasterInfo>{a, b});
  }();
  return two;
}

// Their posts, of which there are none.
const PostSource& posts() {
  static const PostSource source(catalogue(), false, [](const std::string&, const std::string&) {});
  return source;
}

// Small blocks, of which all levels fit into a few kilobytes: beside a pole or the equator, as the file's row says.
ChunkPlan plan_for(const Header& header) {
  ChunkPlan plan;
  plan.node = {kRootLevel, header.row % 2 == 0 ? 0 : rows_of(kRootLevel) / 2, 3};
  plan.base_level = 2;
  plan.direct = false;
  plan.fingerprint = 12345;
  plan.exists = true;
  return plan;
}

Header header_of(const std::string& bytes) {
  Header header{};
  std::memcpy(&header, bytes.data(), std::min(bytes.size(), sizeof header));
  return header;
}

std::string repaired(const std::string& input, const ChunkPlan& plan) {
  std::string bytes = input;
  if (bytes.size() < sizeof(Header)) return bytes;
  Header header = header_of(bytes);
  std::memcpy(header.magic, format::kMagic, sizeof format::kMagic);
  header.total_bytes = bytes.size();
  header.fingerprint = plan.fingerprint;
  header.level = plan.node.level, header.row = plan.node.row, header.col = plan.node.col;
  header.base_level = plan.base_level;
  const std::uint64_t head =
      sizeof(Header) + std::uint64_t{header.records} * sizeof(Chunk::Record) + header.names_bytes;
  std::memcpy(bytes.data(), &header, sizeof header);
  if (head > bytes.size()) return bytes;
  for (std::uint32_t i = 0; i < header.records; ++i) {
    char* const at = bytes.data() + sizeof(Header) + i * sizeof(Chunk::Record);
    Chunk::Record record;
    std::memcpy(&record, at, sizeof record);
    if (record.offset > bytes.size() || record.size > bytes.size() - record.offset) continue;
    record.checksum = dem::hash_of(bytes.data() + record.offset, record.size);
    std::memcpy(at, &record, sizeof record);
  }
  header.head_checksum =
      format::checksum_of_head(header, std::string_view(bytes).substr(sizeof header, head - sizeof header));
  std::memcpy(bytes.data(), &header, sizeof header);
  return bytes;
}

void check_block(const Block& block) {
  const auto posts = static_cast<std::size_t>(block.side()) * static_cast<std::size_t>(block.side());
  require(block.vertices.size() == posts, "a block has its posts");
  require(block.sources.size() == 1 || block.sources.size() == posts, "and their sources");
  require(std::isfinite(block.error_m) && block.error_m >= 0, "an error is a distance");
  require(std::isfinite(block.min_m) && std::isfinite(block.max_m), "bounds are finite");
  for (const auto& [height, normal] : block.vertices) {
    require(std::isnan(height) || (height >= block.min_m && height <= block.max_m), "heights are within bounds");
    require(std::abs(normal.norm() - 1) < 1e-4F, "a normal is a direction");
  }
  for (const SourceMark s : block.sources)
    require((s & kNoSource) == kNoSource || (s & kNoSource) < catalogue().rasters().size(),
            "a source is in the catalogue");
}

bool same(const Block& a, const Block& b) {
  const auto same_bits = [](const Vertex& x, const Vertex& y) { return std::memcmp(&x, &y, sizeof x) == 0; };
  return a.error_m == b.error_m && a.min_m == b.min_m && a.max_m == b.max_m && a.sources == b.sources &&
         std::equal(a.vertices.begin(), a.vertices.end(), b.vertices.begin(), b.vertices.end(), same_bits);
}

// The names are those that check_round_trip writes.
bool names_both(const std::string& file) {
  constexpr std::string_view kNames("a.lbl\0b.lbl\0", 12);
  const Header header = header_of(file);
  return header.names_bytes == kNames.size() &&
         std::string_view(file).substr(sizeof header + header.records * sizeof(Chunk::Record), kNames.size()) == kNames;
}

struct Loaded {
  Chunk::Record record;
  std::string bytes;
  std::shared_ptr<const Block> block;
};

// Every block that the chunk gives; a damaged one must say so.
std::vector<Loaded> load_all(const Chunk& chunk, const std::string& file, const ChunkPlan& plan) {
  std::vector<Loaded> loaded;
  for (int level = 0; level <= plan.base_level; ++level) {
    const BlockId id{level, plan.node.row, plan.node.col};
    const Chunk::Record* record = chunk.find(id);
    if (!record) continue;
    try {
      const auto block = chunk.load(id, posts());
      if (block) check_block(*block);
      loaded.push_back({*record, file.substr(record->offset, record->size), block});
    } catch (const DataError&) {
    }
  }
  return loaded;
}

// What was read, written anew, reads the same.
void check_round_trip(std::vector<Loaded> loaded, const Header& header, const ChunkPlan& plan) {
  const std::vector<const RasterInfo*> sources{&catalogue().rasters()[0], &catalogue().rasters()[1]};
  const std::string file = format::assemble(plan, header.quantisation_m, sources, [&](auto&& each) {
    for (Loaded& l : loaded) each(l.record, l.bytes);
  });
  const auto chunk = Chunk::from_bytes(file, plan, catalogue());
  for (const Loaded& l : loaded) {
    const auto again = chunk->load({l.record.level, l.record.row, l.record.col}, posts());
    require(!again == !l.block && (!again || same(*again, *l.block)), "what is written reads the same");
  }
}

void check_file(const std::string& file, const ChunkPlan& plan) {
  try {
    const auto chunk = Chunk::from_bytes(file, plan, catalogue());
    const std::vector<Loaded> loaded = load_all(*chunk, file, plan);
    if (names_both(file)) check_round_trip(loaded, header_of(file), plan);
  } catch (const DataError&) {
  }
}

}  // namespace
}  // namespace selenograph::fuzz

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace selenograph;
  const std::string input(fuzz::text_of(data, size));
  const dem::ChunkPlan plan = fuzz::plan_for(fuzz::header_of(input));
  fuzz::check_file(input, plan);
  fuzz::check_file(fuzz::repaired(input, plan), plan);
  return 0;
}
