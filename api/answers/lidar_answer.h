// A lidar's returns as JSON and as arrays.
#pragma once

#include <string>

#include "api/encode/negotiate.h"
#include "api/requests/lidar_json.h"
#include "api/schema/answers.h"
#include "engine/lidar/lidar.h"

namespace selenograph::api {

// Media types of the answer, in the order of the server's preference.
inline constexpr Alternative kLidarAnswers[] = {
    {"application/x-npz", "an array for each column, of as many rows as there are beams, and `meta.json`"},
    {"application/json", "the same as a list of beams, null for NaN; of no more beams than a request has rays"},
};

// Returns the schema of one beam: its columns, by name.
OrderedJson lidar_return_schema();
OrderedJson lidar_json(const engine::LidarReturns& returns, const LidarQuery& query, const StopToken& stop);
std::string lidar_npz(const engine::LidarReturns& returns, const LidarQuery& query, const StopToken& stop);
// Returns the columns with their meanings as a Markdown list for the API document.
std::string lidar_columns_text();

}  // namespace selenograph::api
