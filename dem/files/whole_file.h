// Atomic writing of files: under a temporary name, then renamed.
#pragma once

#include <optional>
#include <string>
#include <string_view>

#include "dem/files/open_file.h"

namespace selenograph::dem {

// Text in the name of an unfinished file, PATH.tmp-PROCESS-NUMBER.
inline constexpr std::string_view kTemporaryMark = ".tmp-";

// A file that is there whole or not at all: it is written under a temporary name beside its own, which finish() gives
// it. Without finish() nothing is left. All functions throw SystemFault naming the file.
class WholeFile {
 public:
  // Without `flush` the file may have any content after a power failure: its reader must notice.
  explicit WholeFile(std::string path, bool flush = true);
  ~WholeFile();
  WholeFile(const WholeFile&) = delete;
  WholeFile& operator=(const WholeFile&) = delete;

  void write(std::string_view bytes);
  // Flushes, renames, and flushes the folder, which has the new name.
  void finish();

 private:
  const std::string path_;
  const bool flush_;
  std::string temporary_;  // empty: renamed
  std::optional<OpenFile> file_;
};

// Writes a WholeFile, in a folder that is made if it is missing.
void write_whole_file(const std::string& path, std::string_view bytes, bool flush = true);

// Removes temporary files left by killed processes in a folder and its subfolders: names with `mark` followed by the
// number of a process that no longer exists.
void remove_stale_temporaries(const std::string& folder, std::string_view mark);

}  // namespace selenograph::dem
