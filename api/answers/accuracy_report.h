// Reports of `verify accuracy`: the sweep's rows as CSV and Markdown, and their context as JSON.
#pragma once

#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "engine/verify/accuracy_sweep.h"

namespace selenograph::api {

// Returns the samples of a setting: "4", or "4, edges" with edge samples.
std::string samples_text(const engine::Accuracy& setting);

// Returns CSV: a header line, then one line per row. Errors are in the unit that the column's name ends in, shares are
// fractions.
std::string accuracy_csv(const std::vector<engine::SweepRow>& rows);

// Returns a page with one table per scene. `machine` names the machine on which the times were measured.
std::string accuracy_markdown(const std::vector<engine::SweepRow>& rows,
                              const std::vector<engine::AccuracyScene>& scenes, const std::string& machine);

// Returns the machine, the descriptions of the scenes, the default setting and the software version.
nlohmann::ordered_json accuracy_json(const std::vector<engine::AccuracyScene>& scenes, const std::string& machine);

}  // namespace selenograph::api
