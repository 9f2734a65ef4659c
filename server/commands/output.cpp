#include "server/commands/output.h"

#include <fmt/format.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <stdexcept>
#include <system_error>

#include "api/message/json_text.h"
#include "dem/base/error.h"
#include "dem/files/whole_file.h"

namespace selenograph::server {

namespace fs = std::filesystem;

bool is_standard_output(const std::string& path) {
  struct stat named {};
  struct stat standard {};
  return ::stat(path.c_str(), &named) == 0 && ::fstat(STDOUT_FILENO, &standard) == 0 &&
         named.st_dev == standard.st_dev && named.st_ino == standard.st_ino;
}

namespace {

[[noreturn]] void refuse(const std::string& path, const std::error_code& error) {
  throw std::runtime_error(path + ": cannot be written: " + error.message());
}

// Returns the system's error of this number; EIO if it is 0: the library failed without saying why.
std::error_code error_of(int number) { return {number != 0 ? number : EIO, std::generic_category()}; }

// Writes into a device, a pipe or standard output. Opening standard output by its name would truncate what it holds.
std::error_code write_into(const std::string& path, const std::string& bytes) {
  errno = 0;
  if (is_standard_output(path)) {
    const bool written = std::fwrite(bytes.data(), 1, bytes.size(), stdout) == bytes.size();
    return written && std::fflush(stdout) == 0 ? std::error_code() : error_of(errno);
  }
  std::ofstream file(path, std::ios::binary);
  file.write(bytes.data(), static_cast<std::streamsize>(bytes.size()));
  file.close();
  return file ? std::error_code() : error_of(errno);
}

// Returns true for a regular file, or one that does not exist yet.
bool is_file(const std::string& path) {
  std::error_code ignored;
  const fs::file_type type = fs::status(path, ignored).type();
  return type == fs::file_type::regular || type == fs::file_type::not_found;
}

// Returns true if write_whole() replaces the file. Replacing a device or a pipe would remove it, and replacing the file
// behind standard output would remove all other output.
bool is_replaced(const std::string& path) { return is_file(path) && !is_standard_output(path); }

// Follows symbolic links; the target need not exist.
fs::path target_of(fs::path path) {
  constexpr int kMaxLinks = 40;  // the limit of Linux
  std::error_code ignored;
  for (int i = 0; i < kMaxLinks && fs::is_symlink(fs::symlink_status(path, ignored)); ++i)
    path = path.parent_path() / fs::read_symlink(path, ignored);
  return path;
}

}  // namespace

void write_whole(const std::string& path, const std::string& bytes) {
  if (!is_replaced(path)) {
    if (const std::error_code error = write_into(path, bytes)) refuse(path, error);
    return;
  }
  try {
    dem::WholeFile file(target_of(path).string());
    file.write(bytes);
    file.finish();
  } catch (const SystemFault& fault) {
    refuse(path, error_of(fault.code()));
  }
}

std::FILE* stream_for_messages(const std::string& path) { return is_standard_output(path) ? stderr : stdout; }

void check_can_be_written(const std::string& path) {
  if (is_standard_output(path)) return;  // already open, whatever the permissions of its name
  // A file is replaced by renaming another one, which needs access to its folder; a device is opened itself.
  const fs::path must_be_writable = is_replaced(path) ? target_of(path).parent_path() / "." : fs::path(path);
  if (std::error_code ignored; fs::is_directory(path, ignored)) refuse(path, error_of(EISDIR));
  if (::access(must_be_writable.c_str(), W_OK) != 0) refuse(path, error_of(errno));
}

void write_json(const std::string& path, const nlohmann::ordered_json& json) {
  write_whole(path, api::json_text(json, 2) + "\n");
}

ProgressBar::ProgressBar() : terminal_(::isatty(STDERR_FILENO) == 1) {}

void ProgressBar::show(double share, const std::string& detail) {
  const int percent = static_cast<int>(100 * share);
  // A file gets a line every five percent; a terminal's line is rewritten.
  if (!terminal_ && percent < last_percent_ + 5 && share < 1) return;
  last_percent_ = percent;
  constexpr int kWidth = 30;
  const std::string bar(static_cast<std::size_t>(kWidth * percent / 100), '#');
  const std::chrono::duration<double> spent = std::chrono::steady_clock::now() - start_;
  const std::string left = share > 0 ? fmt::format("{:.0f} s left  ", spent.count() / share * (1 - share)) : "";
  fmt::print(stderr, "{}[{:<{}}] {:3}%  {}{}{}", terminal_ ? "\r\033[K" : "", bar, kWidth, percent, left, detail,
             terminal_ && share < 1 ? "" : "\n");
}

void ProgressBar::end_line() const {
  if (terminal_) fmt::print(stderr, "\n");
}

}  // namespace selenograph::server
