// All tables of requests' members, for the API document and for requests.md.
#pragma once

#include <string>
#include <vector>

#include "api/schema/members.h"

namespace selenograph::api {

// Each request's, followed by those of the objects in it; each once.
std::vector<const MemberTable*> request_tables();

// requests.md: the tables as text, with the defaults of the limits.
std::string requests_markdown();

}  // namespace selenograph::api
