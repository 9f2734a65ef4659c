#include "api/message/version.h"

namespace selenograph::api {

std::string_view software_version() { return SELENOGRAPH_VERSION; }

}  // namespace selenograph::api
