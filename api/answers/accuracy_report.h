// What `verify accuracy` leaves behind: the sweep's rows as CSV and Markdown, and what they belong to as JSON.
#pragma once

#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "engine/verify/accuracy_sweep.h"

namespace selenograph::api {

// Of a setting: "4", or "4, edges" with samples at edges.
std::string samples_text(const engine::Accuracy& setting);

// A header line, then a line per row; errors in the units that the column's name ends in, shares as fractions.
std::string accuracy_csv(const std::vector<engine::SweepRow>& rows);

// A table per scene. `machine`: where the times were measured.
std::string accuracy_markdown(const std::vector<engine::SweepRow>& rows,
                              const std::vector<engine::AccuracyScene>& scenes, const std::string& machine);

// The machine, the scenes in words, and the default setting: what a reader of the CSV needs besides.
nlohmann::ordered_json accuracy_json(const std::vector<engine::AccuracyScene>& scenes, const std::string& machine);

}  // namespace selenograph::api
