// What is said about a frame besides its pixels: meta.json, headers, content hash. Deterministic: no times, no
// counters.
#pragma once

#include <cstdint>
#include <nlohmann/json.hpp>
#include <string>
#include <string_view>

#include "api/answers/metadata_members.h"
#include "api/encode/negotiate.h"
#include "api/requests/frame_json.h"
#include "dem/catalogue/catalogue.h"
#include "engine/frame/report.h"
#include "engine/frame/surface.h"

namespace selenograph::api {

// 32 hexadecimal digits that stand for an answer's bytes: resolved request, terrain (Catalogue::fingerprint), software
// version and representation go in, and the frame's FrameReport::shadow_limits_px where they gave way. All of it can be
// known before anything is rendered, so that If-None-Match costs no frame.
std::string content_hash(const FrameQuery& query, const std::vector<double>& shadow_limits_px,
                         std::uint64_t terrain_fingerprint, const Representation& representation);

// The same of any text.
std::string content_hash(const std::string& text);

// True when an If-None-Match header names this hash's entity tag (weak tags count: RFC 9110, 13.1.2), or is "*".
bool names_etag(const std::string& if_none_match, const std::string& hash);

// Of each aim that gave way (Accuracy), appended.
void warn_of_aims(const engine::Accuracy& asked, const engine::FrameReport& report, nlohmann::ordered_json& warnings);

nlohmann::ordered_json metadata(const FrameQuery& query, const engine::FrameReport& report,
                                const dem::Catalogue& catalogue, const std::string& hash);

// The same for the header `Selenograph-Meta`: compact, ASCII only, at most kMetaHeaderBytes. Where it would be longer,
// the lists of sources and then of warnings are replaced by their lengths ("sources_omitted"), and if that is not
// enough all but the hash goes. What is left out is found at "metadata_at" for a while.
inline constexpr std::size_t kMetaHeaderBytes = 6000;  // HTTP libraries commonly refuse lines beyond 8192
struct MetadataHeader {
  std::string text;
  bool whole;
};
MetadataHeader metadata_header(nlohmann::ordered_json metadata);

}  // namespace selenograph::api
