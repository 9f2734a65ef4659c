// Answers to a manifest's lines, as POST /v1/frames gives them.
#pragma once

#include <atomic>
#include <string>
#include <string_view>

#include "api/service.h"
#include "server/campaign/manifest.h"

namespace selenograph::server {

// Kinds of answers. A line that is refused never becomes a frame; one that failed may do so later.
enum class Outcome { frame, not_modified, refused, failed, cancelled };

struct Answer {
  Outcome outcome = Outcome::cancelled;
  api::Response response;

  std::string header(std::string_view name) const;
};

// Thread-safe.
class FrameSource {
 public:
  // `format`: an extension of api::representations(). Throws std::runtime_error if it is none.
  FrameSource(const Manifest& manifest, const api::Service& service, const std::string& format,
              std::atomic<bool>& stop);

  Answer render(const ManifestLine& line) const { return answer(line, {}); }
  // Asks for the line's ETag without rendering: Outcome::not_modified.
  Answer identify(const ManifestLine& line) const { return answer(line, "*"); }

 private:
  Answer answer(const ManifestLine& line, const std::string& if_none_match) const;
  Outcome outcome_of(int status) const;

  const Manifest& manifest_;
  const api::Service& service_;
  std::string media_type_;
  std::atomic<bool>& stop_;
};

}  // namespace selenograph::server
