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

// Returns 32 hexadecimal digits that identify a response's bytes. The hash covers the resolved request, the terrain
// (Catalogue::fingerprint), the versions of the assets in the request, the software version and the representation. It
// also covers `shadow_limits_px`, where the target for shadows was relaxed to fit into memory; the share of the Sun
// that the Earth covers, where it covers some (sun_covered); and the time from the sky's epoch to that of the poses in
// ICRF, where that turns the stars visibly (sky_turned_deg). All of it is known before drawing: If-None-Match costs no
// frame. shadow_limits_px: those of the frame and of each further exposure sample (FrameReport).
std::string content_hash(const FrameQuery& query, const std::vector<double>& shadow_limits_px,
                         std::uint64_t terrain_fingerprint, const Representation& representation);

// Returns 32 hexadecimal digits that identify a text.
std::string content_hash(const std::string& text);

// Returns true when an If-None-Match header names this hash's entity tag (weak tags count: RFC 9110, 13.1.2), or is
// "*".
bool names_etag(const std::string& if_none_match, const std::string& hash);

// Appends a warning if the band is probably in nanometres.
void warn_of_band(const engine::FrameRequest& request, nlohmann::ordered_json& warnings);
// Appends a warning for each target of the requested accuracy that was relaxed or missed.
void warn_of_relaxed_targets(const engine::Accuracy& requested, const engine::FrameReport& report,
                             nlohmann::ordered_json& warnings);

// `labels`: null for a request without them.
nlohmann::ordered_json metadata(const FrameQuery& query, const engine::FrameReport& report,
                                const dem::Catalogue& catalogue, const std::string& hash, const FrameLabels* labels);

// Returns the metadata as text: on one line if they have a list of craters, which is long, else indented.
std::string metadata_text(const nlohmann::ordered_json& metadata, bool with_craters);

// Adds the header `Selenograph-Warnings`, if there are any: compact ASCII JSON with as many warnings as fit into
// kMetaHeaderBytes.
void add_warnings(Response& response, const nlohmann::ordered_json& warnings);

inline constexpr std::size_t kMetaHeaderBytes = 6000;  // HTTP libraries commonly refuse lines beyond 8192
// Text of the header `Selenograph-Meta`.
struct MetadataHeader {
  std::string text;
  bool complete;  // nothing was omitted
};
// Returns the metadata for the header `Selenograph-Meta`: compact, ASCII only, at most kMetaHeaderBytes. Too long
// metadata lose the lists of craters, sources and warnings, in this order, which are replaced by their lengths
// ("sources_omitted"). If that is not enough, only the hash remains. "metadata_at" is the path of the complete
// metadata.
MetadataHeader metadata_header(nlohmann::ordered_json metadata);

}  // namespace selenograph::api
