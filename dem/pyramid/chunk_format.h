// Bytes of a chunk file. All numbers are little-endian; XXH3 checksums cover all bytes.
//
//    0        64                 64 + 64 n                                                  total_bytes
//    +--------+------------------+------------------+---------+---------+-------------------+
//    | Header | Record 0 .. n-1  | names of sources | block 0 | block 1 | ...     block n-1 |
//    +--------+------------------+------------------+---------+---------+-------------------+
//    |<--------------- head_checksum -------------->|   Record: offset, size and checksum of its block
//                                 paths, each + NUL
//
//    block: heights, (quads + 1 + 2 kHalo)^2, row by row from the south-west: uint16 steps above lowest_m (kSteps),
//           or float32; then the sources of the (quads + 1)^2 posts as Runs. kEmpty and kFromSources: no bytes.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <string>
#include <string_view>
#include <type_traits>
#include <vector>

#include "dem/base/hash.h"
#include "dem/files/raster_info.h"
#include "dem/grid/block.h"
#include "dem/pyramid/chunk_plan.h"

namespace selenograph::dem::format {

inline constexpr char kMagic[8] = {'S', 'G', 'P', 'Y', 'R', 'A', 'M', '2'};

// Returns the step of the heights of filtered levels: a power of two, so that steps are exact as float. Up to level 12
// the slope between two posts is known to 0.0006 or better; 16 bits cover a slope of over 28 degrees across a block, or
// all lunar heights. The step depends on the level only: adjacent blocks agree on their border.
inline double height_step_m(int level) { return std::clamp(std::ldexp(1.0, 4 - level), 1.0 / 256, 0.5); }
inline constexpr std::uint16_t kVoidSteps = 65535;  // stored for a post without data

// Entry of a block in the file's index.
struct Record {
  std::int32_t level = 0, row = 0, col = 0;
  std::uint32_t flags = 0;
  std::uint64_t offset = 0, size = 0, checksum = 0;
  double error_m = 0;
  float min_m = 0, max_m = 0;
  float lowest_m = 0;  // kSteps: lowest stored height
  std::uint32_t reserved = 0;

  // Flags: heights are stored as steps; the block has no valid post; its heights are read from the source files.
  static constexpr std::uint32_t kSteps = 1, kEmpty = 4, kFromSources = 8;
};

struct Header {
  char magic[8];
  std::uint64_t total_bytes;
  std::uint64_t fingerprint;
  std::uint64_t head_checksum;  // over all bytes before the first block, with this member as 0
  double quantisation_m;
  std::int32_t level, row, col, base_level;
  std::uint32_t records, names_bytes;
};
static_assert(std::is_trivially_copyable_v<Header> && std::is_trivially_copyable_v<Record>);

// Consecutive posts, row by row from the south-west, with the same source.
struct Run {
  SourceMark mark;
  std::uint32_t posts;
};

// Returns the checksum of the header and `index`, the bytes between the header and the first block.
inline std::uint64_t checksum_of_head(Header header, std::string_view index) {
  header.head_checksum = 0;
  StreamedHash hash;
  hash.add(header);
  hash.add_text(index);
  return hash.digest();
}

template <typename T>
void append(std::string& out, const std::vector<T>& values) {
  out.append(reinterpret_cast<const char*>(values.data()), values.size() * sizeof(T));
}

// Assembles a chunk file. `for_each(f)` must call f(record, bytes) for every block; it is called three times and must
// keep the order. Sets each record's offset.
template <typename ForEach>
std::string assemble(const ChunkPlan& plan, double quantisation_m, const std::vector<const RasterInfo*>& sources,
                     ForEach&& for_each) {
  std::string names;
  for (const RasterInfo* info : sources) names.append(info->path.c_str(), info->path.size() + 1);
  Header header{};
  std::memcpy(header.magic, kMagic, sizeof kMagic);
  header.fingerprint = plan.fingerprint;
  header.quantisation_m = quantisation_m;
  header.level = plan.node.level;
  header.row = plan.node.row;
  header.col = plan.node.col;
  header.base_level = plan.base_level;
  header.names_bytes = static_cast<std::uint32_t>(names.size());
  for_each([&](Record&, std::string&) { ++header.records; });
  std::uint64_t offset = sizeof(Header) + header.records * sizeof(Record) + names.size();
  std::string index;
  for_each([&](Record& record, std::string&) {
    record.offset = offset;
    offset += record.size;
    index.append(reinterpret_cast<const char*>(&record), sizeof record);
  });
  index += names;
  header.total_bytes = offset;
  header.head_checksum = checksum_of_head(header, index);
  std::string out(reinterpret_cast<const char*>(&header), sizeof header);
  out.reserve(offset);
  out += index;
  for_each([&](Record&, std::string& bytes) { out += bytes; });
  return out;
}

}  // namespace selenograph::dem::format
