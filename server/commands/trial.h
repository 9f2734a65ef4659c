// `serve --trial`: one request over HTTP to each kind of endpoint of a running service.
#pragma once

#include <string>

#include "dem/catalogue/catalogue.h"

namespace selenograph::server {

// Prints one line per check to stdout. Returns true if all passed.
bool run_trial(const std::string& url, const dem::Catalogue& catalogue);

}  // namespace selenograph::server
