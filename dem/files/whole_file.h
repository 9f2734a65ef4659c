// Atomic writing of files: under a temporary name, then renamed.
#pragma once

#include <string>
#include <string_view>

namespace selenograph::dem {

// Writes `bytes` under a temporary name, flushes and renames; on failure the temporary file is removed. Without `flush`
// the file may have any content after a power failure: its reader must notice. Throws SystemFault naming the path.
void write_whole_file(const std::string& path, std::string_view bytes, bool flush = true);

// Removes temporary files left by killed processes in a folder and its subfolders: names with `mark` followed by the
// number of a process that no longer exists.
void remove_stale_temporaries(const std::string& folder, std::string_view mark);

}  // namespace selenograph::dem
