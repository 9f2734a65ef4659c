// All member tables of the requests, for the API document and for requests.md.
#pragma once

#include <string>
#include <vector>

#include "api/schema/members.h"

namespace selenograph::api {

// The table of each request, followed by those of its objects; each once.
std::vector<const MemberTable*> request_tables();

// The text of requests.md: the tables, with the default limits.
std::string requests_markdown();

}  // namespace selenograph::api
