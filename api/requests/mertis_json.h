// Requests and answers of the spectrometer, as JSON and CSV: for POST /v1/verify/mertis and `selenograph verify
// mertis`.
#pragma once

#include <string>
#include <vector>

#include "api/schema/answers.h"
#include "dem/base/stop_token.h"
#include "engine/sensor/spectrometer.h"

namespace selenograph::api {

inline constexpr int kMaxChannels = 10000;

// A resolved request: the instrument, and the temperatures of the blackbodies that it observes.
struct MertisQuery {
  engine::Spectrometer spectrometer;
  std::vector<double> temperatures_k{350, 500};  // assumed: the paper's text has no numbers for its figure 6
};

const Members<MertisQuery>& mertis_members();
// Parses a request. Throws RequestError with all faults found. All members are optional; the defaults are MERTIS.
MertisQuery read_mertis(const Json& body);

// Input of the answer, which has the resolved instrument, the assumptions, and the results per temperature and channel.
struct SpectraSource {
  const MertisQuery& query;
  const StopToken& stop;  // stops between channels
};
const Answer<SpectraSource>& mertis_answer();

}  // namespace selenograph::api
