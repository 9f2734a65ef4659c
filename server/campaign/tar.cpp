#include "server/campaign/tar.h"

#include <archive.h>
#include <archive_entry.h>
#include <fmt/format.h>

#include <filesystem>
#include <memory>
#include <stdexcept>

namespace selenograph::server {
namespace {

constexpr std::uint64_t kTarBlockBytes = 512;

using Archive = std::unique_ptr<::archive, int (*)(::archive*)>;

void require_ok(int result, ::archive* archive, const std::string& path) {
  if (result == ARCHIVE_OK) return;
  const char* why = ::archive_error_string(archive);
  throw std::runtime_error(fmt::format("{}: {}", path, why ? why : "libarchive failed"));
}

// Callback of libarchive that writes.
la_ssize_t append_to_string(::archive*, void* out, const void* bytes, std::size_t count) {
  static_cast<std::string*>(out)->append(static_cast<const char*>(bytes), count);
  return static_cast<la_ssize_t>(count);
}

std::uint64_t padded(std::uint64_t bytes) { return (bytes + kTarBlockBytes - 1) / kTarBlockBytes * kTarBlockBytes; }

}  // namespace

std::string tar_member(const std::string& name, std::string_view content) {
  std::string bytes_of_tar;
  bytes_of_tar.reserve(content.size() + 4 * kTarBlockBytes);
  const Archive archive(::archive_write_new(), ::archive_write_free);
  const auto require = [&](int result) { require_ok(result, archive.get(), name); };
  require(::archive_write_set_format_ustar(archive.get()));
  require(::archive_write_set_bytes_per_block(archive.get(), 0));  // no padding to records of several blocks
  require(::archive_write_open(archive.get(), &bytes_of_tar, nullptr, append_to_string, nullptr));
  const std::unique_ptr<::archive_entry, decltype(&::archive_entry_free)> entry(::archive_entry_new(),
                                                                                ::archive_entry_free);
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

std::vector<TarMember> list_tar(const std::string& path) {
  const Archive archive(::archive_read_new(), ::archive_read_free);
  const auto require = [&](int result) { require_ok(result, archive.get(), path); };
  require(::archive_read_support_format_tar(archive.get()));
  require(::archive_read_open_filename(archive.get(), path.c_str(), kTarBlockBytes));
  std::vector<TarMember> members;
  std::uint64_t end = 0;
  ::archive_entry* entry = nullptr;
  for (;;) {
    const int result = ::archive_read_next_header(archive.get(), &entry);
    if (result == ARCHIVE_EOF) break;
    require(result);
    const char* name = ::archive_entry_pathname(entry);
    const auto header = static_cast<std::uint64_t>(::archive_read_header_position(archive.get()));
    members.push_back(
        {name ? name : "", header + kTarBlockBytes, static_cast<std::uint64_t>(::archive_entry_size(entry))});
    end = header + kTarBlockBytes + padded(members.back().bytes);
  }
  // libarchive skips the content by seeking, also beyond the end of the file.
  if (std::filesystem::file_size(path) != end + tar_end().size()) throw std::runtime_error(path + ": is cut short");
  return members;
}

void check_zip(std::string_view bytes, const std::string& name) {
  const Archive archive(::archive_read_new(), ::archive_read_free);
  const auto require = [&](int result) { require_ok(result, archive.get(), name); };
  // Read by the directory, which is at the end: an archive that is cut short has none.
  require(::archive_read_support_format_zip_seekable(archive.get()));
  require(::archive_read_open_memory(archive.get(), bytes.data(), bytes.size()));
  ::archive_entry* entry = nullptr;
  for (int result; (result = ::archive_read_next_header(archive.get(), &entry)) != ARCHIVE_EOF;) {
    require(result);
    const void* block = nullptr;
    std::size_t size = 0;
    la_int64_t offset = 0;
    do {
      result = ::archive_read_data_block(archive.get(), &block, &size, &offset);
    } while (result == ARCHIVE_OK);
    if (result != ARCHIVE_EOF) require(result);
  }
}

}  // namespace selenograph::server
