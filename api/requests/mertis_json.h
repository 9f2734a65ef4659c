// A spectrometer's request and its channels, as JSON and CSV: for POST /v1/verify/mertis and for `selenograph
// verify mertis`.
#pragma once

#include <string>
#include <vector>

#include "api/schema/answers.h"
#include "dem/support/stop_token.h"
#include "engine/sensor/spectrometer.h"

namespace selenograph::api {

inline constexpr int kMaxChannels = 10000;

struct MertisQuery {
  engine::Spectrometer spectrometer;
  std::vector<double> temperatures_k{350, 500};  // assumed: of the paper's figure 6 there is no number in the text
};

const Members<MertisQuery>& mertis_members();
// Throws RequestError with every fault found. Every member may be left out: MERTIS.
MertisQuery read_mertis(const Json& body);

// The instrument as understood, what was assumed, and per temperature and channel what the equations give.
struct SpectraSource {
  const MertisQuery& query;
  const StopToken& stop;  // stops between channels
};
const Answer<SpectraSource>& mertis_answer();

// One row per channel and temperature.
std::string mertis_csv(const MertisQuery& query);

}  // namespace selenograph::api
