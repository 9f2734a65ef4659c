// A campaign's frame on disk, a file of its own or a member of a tar.
#pragma once

#include <cstdint>
#include <optional>
#include <string>

#include "server/campaign/manifest.h"

namespace selenograph::server {

// Returns the path of a file in a folder.
std::string in_folder(const std::string& folder, const std::string& name);

struct FrameFile {
  std::string path;
  std::uint64_t offset = 0, bytes = 0;  // of the frame in the file
};

// Returns true if the frame's metadata have this content hash, the ETag of a request over a terrain by a software. A
// damaged frame may hold it, too. Throws std::runtime_error naming an unreadable file.
bool has_content_hash(const FrameFile& frame, const std::string& hash);

// Reads a frame to its end. Throws std::runtime_error naming the file if it is cut short or, in an .npz or PNG, differs
// from its checksums. TIFF and OpenEXR have none.
void check_whole(const FrameFile& frame);

// Path of the problem of a line that the service refused: the problem document, with the line's "request".
std::string problem_path(const std::string& folder, const ManifestLine& line);
// Returns the recorded problem of the line; empty if there is none, or one of another request. Throws
// std::runtime_error naming an unreadable file.
std::optional<Problem> recorded_problem(const std::string& folder, const Manifest& manifest, const ManifestLine& line);
void record_problem(const std::string& folder, const Manifest& manifest, const ManifestLine& line, Problem problem);

}  // namespace selenograph::server
