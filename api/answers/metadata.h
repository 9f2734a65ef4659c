// Metadata of a frame: meta.json, headers, content hash. Deterministic: no times, no counters.
#pragma once

#include <cstdint>
#include <nlohmann/json.hpp>
#include <string>
#include <string_view>

#include "api/answers/metadata_members.h"
#include "api/encode/negotiate.h"
#include "api/message/message.h"
#include "api/requests/frame_json.h"
#include "dem/catalogue/catalogue.h"
#include "engine/frame/report.h"
#include "engine/frame/surface.h"

namespace selenograph::api {

// 32 hexadecimal digits that identify a response's bytes. Input: the resolved request, the terrain
// (Catalogue::fingerprint), the versions of the assets it uses, the software version, the representation, and
// FrameReport::shadow_limits_px if they were relaxed, what an eclipse covers (sun_covered), and how far the sky is of
// another epoch than poses (sky_turned_deg). All of it is known before rendering, so If-None-Match costs no frame.
std::string content_hash(const FrameQuery& query, const std::vector<double>& shadow_limits_px,
                         std::uint64_t terrain_fingerprint, const Representation& representation);

// Hash of any text.
std::string content_hash(const std::string& text);

// True when an If-None-Match header names this hash's entity tag (weak tags count: RFC 9110, 13.1.2), or is "*".
bool names_etag(const std::string& if_none_match, const std::string& hash);

// Appends a warning where the band is probably given in another unit.
void warn_of_band(const engine::FrameRequest& request, nlohmann::ordered_json& warnings);
// Appends a warning for each relaxed target (Accuracy).
void warn_of_aims(const engine::Accuracy& asked, const engine::FrameReport& report, nlohmann::ordered_json& warnings);

nlohmann::ordered_json metadata(const FrameQuery& query, const engine::FrameReport& report,
                                const dem::Catalogue& catalogue, const std::string& hash);

// As text: indented or, with a list of craters, which is long, on one line.
std::string metadata_text(const nlohmann::ordered_json& metadata, bool with_craters);

// Adds the header `Selenograph-Warnings`, if there are any: a list as compact ASCII JSON, as many as fit into
// kMetaHeaderBytes.
void add_warnings(Response& response, const nlohmann::ordered_json& warnings);

// The metadata for the header `Selenograph-Meta`: compact, ASCII only, at most kMetaHeaderBytes. If it is longer, the
// lists of craters, sources and then warnings are replaced by their lengths ("sources_omitted"), and if that is not
// enough everything but the hash is omitted. The full metadata are at "metadata_at" for a while.
inline constexpr std::size_t kMetaHeaderBytes = 6000;  // HTTP libraries commonly refuse lines beyond 8192
struct MetadataHeader {
  std::string text;
  bool whole;
};
MetadataHeader metadata_header(nlohmann::ordered_json metadata);

}  // namespace selenograph::api
