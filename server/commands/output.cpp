#include "server/commands/output.h"

#include <fmt/format.h>
#include <unistd.h>

#include <cerrno>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <stdexcept>
#include <system_error>

namespace selenograph::server {

namespace fs = std::filesystem;

void write_whole(const std::string& path, const std::string& bytes) {
  const std::string temporary = path + ".part-" + std::to_string(::getpid());
  errno = 0;
  std::ofstream file(temporary, std::ios::binary);
  file.write(bytes.data(), static_cast<std::streamsize>(bytes.size()));
  file.close();
  std::error_code error, ignored;
  if (!file) error.assign(errno != 0 ? errno : EIO, std::generic_category());
  if (!error) fs::rename(temporary, path, error);
  if (!error) return;
  fs::remove(temporary, ignored);
  throw std::runtime_error(path + ": can't be written: " + error.message());
}

void write_json(const std::string& path, const nlohmann::ordered_json& json) {
  write_whole(path, json.dump(2, ' ', false, nlohmann::ordered_json::error_handler_t::replace) + "\n");
}

ProgressBar::ProgressBar() : terminal_(::isatty(STDERR_FILENO) == 1) {}

void ProgressBar::show(double share, const std::string& detail) {
  const int percent = static_cast<int>(100 * share);
  if (!terminal_ && percent < last_percent_ + 5 && share < 1) return;
  last_percent_ = percent;
  constexpr int kWidth = 30;
  const std::string bar(static_cast<std::size_t>(kWidth * percent / 100), '#');
  const std::chrono::duration<double> spent = std::chrono::steady_clock::now() - start_;
  const double left_s = share > 0 ? spent.count() / share * (1 - share) : 0;
  fmt::print(stderr, "{}[{:<{}}] {:3}%  {:.0f} s left  {}{}", terminal_ ? "\r\033[K" : "", bar, kWidth, percent, left_s,
             detail, terminal_ && share < 1 ? "" : "\n");
}

void ProgressBar::end_line() const {
  if (terminal_) fmt::print(stderr, "\n");
}

}  // namespace selenograph::server
