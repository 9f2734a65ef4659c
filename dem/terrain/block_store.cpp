#include "dem/terrain/block_store.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <filesystem>
#include <tuple>
#include <type_traits>
#include <utility>
#include <vector>

#include "dem/base/error.h"
#include "dem/base/hash.h"
#include "dem/files/open_file.h"
#include "dem/files/whole_file.h"

namespace selenograph::dem {
namespace {

namespace fs = std::filesystem;

constexpr std::string_view kSuffix = ".sgb";

// Everything is little-endian; vertices, sources, ground and brightness follow.
struct Header {
  char magic[8] = {'S', 'G', 'B', 'L', 'O', 'C', 'K', '2'};
  std::uint64_t checksum = 0;  // XXH3 of the file with 0 in this place
  std::uint64_t key = 0;
  std::int32_t level = 0, row = 0, col = 0;
  std::uint32_t vertices = 0, sources = 0, ground = 0, brightness = 0;
  std::uint32_t unused = 0;  // leaves no uninitialised bytes before the doubles
  double error_m = 0, detail_error_m = 0, left_out_size_m = 0;
  float min_m = 0, max_m = 0;
  std::size_t bytes() const {
    return sizeof(Header) + vertices * sizeof(Vertex) + sources * sizeof(SourceMark) + ground * sizeof(Ground) +
           brightness * sizeof(std::uint16_t);
  }
};
static_assert(std::is_trivially_copyable_v<Header> && sizeof(Vertex) == 4 * sizeof(float));
constexpr std::size_t kMaxFileBytes = std::size_t{16} << 20;

// Shares of the limit, as divisors: a scan leaves a quarter free, and each process scans again after a 32nd. So the
// files of eight processes stay within the limit.
constexpr std::size_t kShareFreed = 4, kShareBetweenScans = 32;

// Returns the bytes that a file occupies on disk, in blocks of 4 KiB.
std::size_t disk_bytes(std::size_t file_bytes) {
  constexpr std::size_t kDiskBlock_bytes = 4096;
  return (file_bytes + kDiskBlock_bytes - 1) / kDiskBlock_bytes * kDiskBlock_bytes;
}

// Returns the checksum of a file's content; sets the checksum in its header to 0 first.
std::uint64_t checksum_of(std::string& file) {
  std::memset(file.data() + offsetof(Header, checksum), 0, sizeof(Header::checksum));
  return hash_of(file.data(), file.size());
}

template <typename T>
void append(std::string& file, const std::vector<T>& values) {
  file.append(reinterpret_cast<const char*>(values.data()), values.size() * sizeof(T));
}

// Copies `count` values from a file's bytes; returns the byte after them.
template <typename T>
const char* take(const char* from, std::size_t count, std::vector<T>& values) {
  values.resize(count);
  std::memcpy(static_cast<void*>(values.data()), from, count * sizeof(T));
  return from + count * sizeof(T);
}

// Returns the content of a block's file.
std::string bytes_of(std::uint64_t key, const Block& block) {
  Header head;
  head.key = key;
  std::tie(head.level, head.row, head.col) = std::tie(block.id.level, block.id.row, block.id.col);
  head.vertices = static_cast<std::uint32_t>(block.vertices.size());
  head.sources = static_cast<std::uint32_t>(block.sources.size());
  head.ground = static_cast<std::uint32_t>(block.ground.size());
  head.brightness = static_cast<std::uint32_t>(block.brightness.size());
  head.error_m = block.error_m;
  head.detail_error_m = block.detail_error_m;
  head.left_out_size_m = block.left_out_size_m;
  head.min_m = block.min_m;
  head.max_m = block.max_m;
  std::string file(reinterpret_cast<const char*>(&head), sizeof head);
  file.reserve(head.bytes());
  append(file, block.vertices);
  append(file, block.sources);
  append(file, block.ground);
  append(file, block.brightness);
  head.checksum = checksum_of(file);
  std::memcpy(file.data(), &head, sizeof head);
  return file;
}

// Returns the block in a file, or null unless the file is complete and has that key and id.
std::shared_ptr<Block> block_of(std::string file, std::uint64_t key, const BlockId& id) {
  Header head;
  if (file.size() < sizeof head) return nullptr;
  std::memcpy(&head, file.data(), sizeof head);
  auto block = std::make_shared<Block>();
  block->id = id;
  block->extent = extent_of(id);
  const auto side = static_cast<std::size_t>(block->side());
  const bool counts_fit = head.vertices == side * side && (head.sources == 1 || head.sources == head.vertices) &&
                          (head.ground <= 1 || head.ground == head.vertices) &&
                          (head.brightness == 0 || head.brightness == head.vertices);
  if (std::memcmp(head.magic, Header().magic, sizeof head.magic) != 0 || head.key != key || head.level != id.level ||
      head.row != id.row || head.col != id.col || !counts_fit || file.size() != head.bytes() ||
      checksum_of(file) != head.checksum)
    return nullptr;
  const char* from = file.data() + sizeof head;
  from = take(from, head.vertices, block->vertices);
  from = take(from, head.sources, block->sources);
  from = take(from, head.ground, block->ground);
  take(from, head.brightness, block->brightness);
  block->error_m = head.error_m;
  block->detail_error_m = head.detail_error_m;
  block->left_out_size_m = head.left_out_size_m;
  block->min_m = head.min_m;
  block->max_m = head.max_m;
  fill_trigonometry(*block);
  return block;
}

}  // namespace

BlockStore::BlockStore(std::string folder, std::size_t bytes, const TroubleLog& trouble)
    : folder_(std::move(folder)), max_bytes_(bytes), trouble_(trouble) {
  remove_stale_temporaries(folder_, std::string(kSuffix) + ".tmp-");
  remove_oldest();
}

std::string BlockStore::path_of(std::uint64_t key, const BlockId& id) const {
  // Divide rows and columns by 16 to name the folder, so that each has at most some hundred files.
  constexpr int kFolderShift = 4;
  return fmt::format("{}/{:016x}/L{:02}/r{}c{}/r{}c{}{}", folder_, key, id.level, id.row >> kFolderShift,
                     id.col >> kFolderShift, id.row, id.col, kSuffix);
}

// Removes a file that is damaged.
std::shared_ptr<const Block> BlockStore::read(std::uint64_t key, const BlockId& id) {
  const std::string path = path_of(key, id);
  if (::access(path.c_str(), R_OK) != 0) return nullptr;
  try {
    const OpenFile file(path, O_RDONLY);
    std::string bytes(std::min<std::uint64_t>(file.state().bytes, kMaxFileBytes), '\0');
    if (!file.read(0, bytes.size(), bytes.data())) return nullptr;
    if (auto block = block_of(std::move(bytes), key, id)) {
      ++read_;
      return block;
    }
  } catch (const SystemFault&) {
    return nullptr;  // another process may have removed it
  } catch (const DataError&) {
    // A FIFO has taken the file's place: remove it, too.
  }
  ::unlink(path.c_str());
  return nullptr;
}

// Stops writing for good after the first failure: the blocks then stay in memory only.
void BlockStore::write(std::uint64_t key, const Block& block) {
  if (broken_) return;
  const std::string path = path_of(key, block.id), bytes = bytes_of(key, block);
  if (!make_space(disk_bytes(bytes.size()))) return;
  try {
    write_whole_file(path, bytes, false);
  } catch (const SystemFault& fault) {
    if (fault.code() == ENOENT) return;  // another process has just removed the empty folder
    if (!broken_.exchange(true))
      trouble_.log(
          fmt::format("ground is no longer kept in {}: {}", folder_, std::generic_category().message(fault.code())));
  }
}

// Counts `bytes` to be written. After each kShareBetweenScans of the limit, it removes files first. Returns false where
// the file must not be written: it is too large, or another thread is removing files, which may take seconds.
bool BlockStore::make_space(std::size_t bytes) {
  if (bytes > max_bytes_ / kShareFreed) return false;
  if (unscanned_bytes_.fetch_add(bytes) + bytes <= max_bytes_ / kShareBetweenScans) return true;
  const std::unique_lock lock(scanning_, std::try_to_lock);
  if (!lock) return false;
  unscanned_bytes_ = bytes;
  remove_oldest();
  return true;
}

// Counts the files of all processes, so that their sum stays within the limit, and removes the oldest.
void BlockStore::remove_oldest() {
  struct File {
    fs::file_time_type written;
    std::string path;
    std::size_t bytes;
  };
  std::vector<File> files;
  std::size_t sum_bytes = 0;
  std::error_code error;
  for (fs::recursive_directory_iterator it(folder_, error), end; !error && it != end; it.increment(error)) {
    std::error_code gone;
    if (it->path().extension() != kSuffix || !it->is_regular_file(gone)) continue;
    const std::size_t bytes = disk_bytes(it->file_size(gone));
    const auto written = it->last_write_time(gone);
    if (gone) continue;
    files.push_back({written, it->path().string(), bytes});
    sum_bytes += bytes;
  }
  if (sum_bytes > max_bytes_ - max_bytes_ / kShareFreed) {
    std::sort(files.begin(), files.end(), [](const File& a, const File& b) { return a.written < b.written; });
    for (const File& file : files) {
      if (sum_bytes <= max_bytes_ - max_bytes_ / kShareFreed) break;
      ::unlink(file.path.c_str());
      ::rmdir(fs::path(file.path).parent_path().c_str());  // once it is empty
      sum_bytes -= file.bytes;
    }
  }
}

}  // namespace selenograph::dem
