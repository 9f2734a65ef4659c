// Reports of `verify accuracy`: the sweep's rows as CSV, and their context as JSON.
#pragma once

#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "engine/verify/accuracy_sweep.h"

namespace selenograph::api {

// Returns CSV: a header line, then one line per row. Errors are in the unit that the column's name ends in, shares are
// fractions.
std::string accuracy_csv(const std::vector<engine::SweepRow>& rows);

// Returns the machine on which the times were measured, the descriptions of the scenes, the default setting and the
// software version.
nlohmann::ordered_json accuracy_json(const std::vector<engine::AccuracyScene>& scenes, const std::string& machine);

}  // namespace selenograph::api
