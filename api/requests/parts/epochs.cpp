#include "api/requests/parts/epochs.h"

#include <fmt/chrono.h>
#include <fmt/format.h>

#include <ctime>

namespace selenograph::api {

std::optional<Epoch> epoch_of(const std::string& utc) {
  std::tm time{};
  ::strptime(utc.c_str(), "%Y-%m-%dT%H:%M:%S", &time);
  const Epoch epoch{std::chrono::seconds(::timegm(&time))};
  // Write the epoch again and compare: strptime accepts February 30, and text behind the seconds.
  const std::string canonical = utc_of(epoch);
  if (utc != canonical && utc + "Z" != canonical) return std::nullopt;
  return epoch;
}

std::string utc_of(Epoch epoch) {
  return fmt::format("{:%Y-%m-%dT%H:%M:%SZ}", fmt::gmtime(std::chrono::system_clock::to_time_t(epoch)));
}

}  // namespace selenograph::api
