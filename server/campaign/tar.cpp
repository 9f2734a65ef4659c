#include "server/campaign/tar.h"

#include <archive.h>
#include <archive_entry.h>
#include <fmt/format.h>

#include <cerrno>
#include <cstring>
#include <fstream>
#include <memory>
#include <stdexcept>
#include <vector>

#include "server/campaign/sha256.h"

namespace selenograph::server {
namespace {

constexpr std::size_t kTarBlockBytes = 512;

struct FreeArchive {
  void operator()(::archive* a) const { ::archive_free(a); }
};
struct FreeEntry {
  void operator()(::archive_entry* e) const { ::archive_entry_free(e); }
};
using Archive = std::unique_ptr<::archive, FreeArchive>;
using Entry = std::unique_ptr<::archive_entry, FreeEntry>;

void require_ok(int result, ::archive* archive, const std::string& what) {
  if (result == ARCHIVE_OK) return;
  const char* why = ::archive_error_string(archive);
  throw std::runtime_error(fmt::format("{}: {}", what, why ? why : "libarchive failed"));
}

// Callback of libarchive that writes.
la_ssize_t append_to_string(::archive*, void* out, const void* bytes, std::size_t count) {
  static_cast<std::string*>(out)->append(static_cast<const char*>(bytes), count);
  return static_cast<la_ssize_t>(count);
}

// A file that is hashed while it is read.
struct HashedFile {
  std::ifstream file;
  Sha256 digest;
  std::vector<char> buffer = std::vector<char>(std::size_t{1} << 20);

  // Returns the next block; empty at the end.
  std::string_view next() {
    file.read(buffer.data(), static_cast<std::streamsize>(buffer.size()));
    const std::string_view block(buffer.data(), static_cast<std::size_t>(file.gcount()));
    digest.add(block);
    return block;
  }
};

// Callback of libarchive that reads the next block of a HashedFile.
la_ssize_t read_hashed(::archive* archive, void* file, const void** bytes) {
  auto& hashed = *static_cast<HashedFile*>(file);
  const std::string_view block = hashed.next();
  if (hashed.file.bad()) {
    ::archive_set_error(archive, EIO, "cannot be read");
    return -1;
  }
  *bytes = block.data();
  return static_cast<la_ssize_t>(block.size());
}

}  // namespace

std::string tar_member(const std::string& name, std::string_view content) {
  std::string bytes_of_tar;
  bytes_of_tar.reserve(content.size() + 4 * kTarBlockBytes);
  const Archive archive(::archive_write_new());
  const auto require = [&](int result) { require_ok(result, archive.get(), name); };
  require(::archive_write_set_format_ustar(archive.get()));
  require(::archive_write_set_bytes_per_block(archive.get(), 0));  // no padding to records of several blocks
  require(::archive_write_open(archive.get(), &bytes_of_tar, nullptr, append_to_string, nullptr));
  const Entry entry(::archive_entry_new());
  ::archive_entry_set_pathname(entry.get(), name.c_str());
  ::archive_entry_set_filetype(entry.get(), AE_IFREG);
  ::archive_entry_set_perm(entry.get(), 0644);
  ::archive_entry_set_mtime(entry.get(), 0, 0);
  ::archive_entry_set_uid(entry.get(), 0);
  ::archive_entry_set_gid(entry.get(), 0);
  ::archive_entry_set_size(entry.get(), static_cast<la_int64_t>(content.size()));
  require(::archive_write_header(archive.get(), entry.get()));
  if (::archive_write_data(archive.get(), content.data(), content.size()) != static_cast<la_ssize_t>(content.size()))
    require_ok(ARCHIVE_FATAL, archive.get(), name);
  require(::archive_write_finish_entry(archive.get()));
  // Cut off the end that closing writes: a tar has one, behind its last member.
  const std::size_t member_bytes = bytes_of_tar.size();
  require(::archive_write_close(archive.get()));
  bytes_of_tar.resize(member_bytes);
  return bytes_of_tar;
}

std::string tar_end() { return std::string(2 * kTarBlockBytes, '\0'); }

std::string read_tar(const std::string& path,
                     const std::function<void(const std::string&, std::uint64_t, const std::string&)>& each) {
  HashedFile file{std::ifstream(path, std::ios::binary), {}};
  if (!file.file) throw std::runtime_error(path + ": cannot be read");
  const Archive archive(::archive_read_new());
  const auto require = [&](int result) { require_ok(result, archive.get(), path); };
  require(::archive_read_support_format_tar(archive.get()));
  require(::archive_read_open(archive.get(), &file, nullptr, read_hashed, nullptr));
  ::archive_entry* entry = nullptr;
  for (;;) {
    const int result = ::archive_read_next_header(archive.get(), &entry);
    if (result == ARCHIVE_EOF) break;
    require(result);
    Sha256 digest;
    std::uint64_t bytes = 0;
    for (;;) {
      const void* block = nullptr;
      std::size_t size = 0;
      la_int64_t offset = 0;
      const int data = ::archive_read_data_block(archive.get(), &block, &size, &offset);
      if (data == ARCHIVE_EOF) break;
      require(data);
      digest.add({static_cast<const char*>(block), size});
      bytes += size;
    }
    const char* name = ::archive_entry_pathname(entry);
    each(name ? name : "", bytes, digest.hex());
  }
  // Hash what is behind the last member, too: libarchive stops reading at the end of the tar.
  while (!file.next().empty()) {
  }
  return file.digest.hex();
}

}  // namespace selenograph::server
