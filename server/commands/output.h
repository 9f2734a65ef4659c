// Output of commands: files written atomically, and a progress line.
#pragma once

#include <chrono>
#include <cstdio>
#include <nlohmann/json_fwd.hpp>
#include <string>

namespace selenograph::server {

// Writes a file atomically and durably (dem::WholeFile); a symbolic link keeps its place, and its target is written.
// Devices and pipes are written into. Standard output, by any name such as /dev/stdout, is appended to. Throws
// std::runtime_error naming the file and the system's reason.
void write_whole(const std::string& path, const std::string& bytes);
// Writes indented JSON with a final newline, atomically. Invalid UTF-8 is replaced.
void write_json(const std::string& path, const nlohmann::ordered_json& json);

// Returns true if the path names standard output.
bool is_standard_output(const std::string& path);
// Returns the stream for messages about a file: stdout, or stderr if the file is standard output itself.
std::FILE* stream_for_messages(const std::string& path);
// Throws as write_whole() if the file could not be opened for writing. Call it before work that would be lost.
void check_can_be_written(const std::string& path);

// Progress on stderr: one line that is rewritten on a terminal, otherwise a line every five percent.
class ProgressBar {
 public:
  ProgressBar();
  // `share`: 0 to 1.
  void show(double share, const std::string& detail);
  // Ends the line after work that stopped early.
  void end_line() const;

 private:
  const bool terminal_;
  const std::chrono::steady_clock::time_point start_ = std::chrono::steady_clock::now();
  int last_percent_ = -5;
};

}  // namespace selenograph::server
