// All member tables of the requests, for the API document and for requests.md.
#pragma once

#include <string>
#include <vector>

#include "api/schema/members.h"

namespace selenograph::api {

// Returns the table of each request, followed by the tables of the objects in it. Each table is listed once.
std::vector<const MemberTable*> request_tables();

// Returns the text of requests.md: all tables, with the default limits.
std::string requests_markdown();

}  // namespace selenograph::api
