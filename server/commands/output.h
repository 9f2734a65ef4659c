// Output of commands: files written atomically, and a progress line.
#pragma once

#include <chrono>
#include <cstdio>
#include <nlohmann/json_fwd.hpp>
#include <string>

namespace selenograph::server {

// Writes a file atomically: of a symbolic link what it names. A device or a pipe is written into, and standard output
// by whatever name, /dev/stdout say, after what it has. Throws std::runtime_error naming the file and the system's
// reason.
void write_whole(const std::string& path, const std::string& bytes);
// Writes indented JSON with a final newline, atomically. Invalid UTF-8 is replaced.
void write_json(const std::string& path, const nlohmann::ordered_json& json);

// Where to say what write_whole() wrote: stdout, or stderr where the file is standard output itself.
std::FILE* said_beside(const std::string& path);
// Throws as write_whole() if it could not begin: before work that would be lost.
void check_can_be_written(const std::string& path);
// Whether both paths are of one file, which need not be there; a device or a pipe is none.
bool is_same_file(const std::string& a, const std::string& b);

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
