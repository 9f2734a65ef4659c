// Output of commands: files written whole, and a progress line.
#pragma once

#include <chrono>
#include <nlohmann/json_fwd.hpp>
#include <string>

namespace selenograph::server {

// Appears whole or not at all. Throws std::runtime_error naming the file.
void write_whole(const std::string& path, const std::string& bytes);
// The same, indented and with a newline at the end. Names that are no UTF-8 get replacement characters.
void write_json(const std::string& path, const nlohmann::ordered_json& json);

// On stderr: one line that is rewritten on a terminal, a line every five percent elsewhere.
class ProgressBar {
 public:
  ProgressBar();
  // share 0..1.
  void show(double share, const std::string& detail);
  // After work that ended early.
  void end_line() const;

 private:
  const bool terminal_;
  const std::chrono::steady_clock::time_point start_ = std::chrono::steady_clock::now();
  int last_percent_ = -5;
};

}  // namespace selenograph::server
