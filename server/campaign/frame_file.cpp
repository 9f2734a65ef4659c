#include "server/campaign/frame_file.h"

#include <fcntl.h>

#include <filesystem>
#include <stdexcept>
#include <vector>

#include "api/encode/image_library.h"
#include "api/encode/read_npz.h"
#include "api/message/json_text.h"
#include "dem/files/files.h"
#include "dem/files/open_file.h"
#include "dem/files/whole_file.h"
#include "server/campaign/tar.h"

namespace selenograph::server {
namespace {

namespace fs = std::filesystem;

constexpr const char* kRequest = "request";  // member of a problem's file

bool is_image(const std::string& path) { return !path.ends_with(".npz") && !path.ends_with(".tar"); }

}  // namespace

std::string in_folder(const std::string& folder, const std::string& name) { return (fs::path(folder) / name).string(); }

bool has_content_hash(const FrameFile& frame, const std::string& hash) {
  if (is_image(frame.path)) return dem::read_whole(frame.path).find(hash) != std::string::npos;
  const auto metadata = api::text_in_npz(frame.path, frame.offset, frame.bytes, "meta.json");
  return metadata && metadata->find(hash) != std::string::npos;
}

void check_whole(const FrameFile& frame) {
  if (!is_image(frame.path)) {
    std::string bytes(frame.bytes, '\0');
    if (!dem::OpenFile(frame.path, O_RDONLY).read(frame.offset, bytes.size(), bytes.data()))
      throw std::runtime_error(frame.path + ": is cut short");
    return check_zip(bytes, frame.path);
  }
  std::vector<double> samples;
  api::image_library().read(frame.path, [&](const api::ImageSize& size) {
    samples.resize(size.width * size.height * static_cast<std::size_t>(size.channels));
    return samples.data();
  });
}

std::string problem_path(const std::string& folder, const ManifestLine& line) {
  return in_folder(folder, line.name + ".problem.json");
}

std::optional<Problem> recorded_problem(const std::string& folder, const Manifest& manifest, const ManifestLine& line) {
  const std::string path = problem_path(folder, line);
  if (!fs::exists(path)) return std::nullopt;
  Problem problem = Problem::parse(dem::read_whole(path), nullptr, false);
  const bool is_of_line =
      problem.is_object() && problem.contains(kRequest) && api::Json(problem[kRequest]) == manifest.request(line);
  return is_of_line ? std::optional(std::move(problem)) : std::nullopt;
}

void record_problem(const std::string& folder, const Manifest& manifest, const ManifestLine& line, Problem problem) {
  problem[kRequest] = manifest.request(line);
  dem::write_whole_file(problem_path(folder, line), api::json_text(problem, 2) + "\n");
}

}  // namespace selenograph::server
