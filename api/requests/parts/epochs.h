// Epochs of a series, in equal steps of UTC without leap seconds, of which there have been none since 2017.
#pragma once

#include <chrono>
#include <optional>
#include <string>

namespace selenograph::api {

using Epoch = std::chrono::sys_seconds;

// Parses "2026-11-20T00:00:00Z", of which the Z may be missing: whole seconds. Empty if it is no such epoch.
std::optional<Epoch> epoch_of(const std::string& utc);
std::string utc_of(Epoch epoch);

}  // namespace selenograph::api
