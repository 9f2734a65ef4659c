#include "tests/support/shared_data.h"

#include <cstdlib>

namespace selenograph::test {

namespace fs = std::filesystem;

std::string shared_data(const std::string& file) {
  const char* given = std::getenv("SELENOGRAPH_SHARED_DATA");
  const fs::path root = given ? fs::path(given) : fs::path(SELENOGRAPH_SOURCE_DIR) / "../shared/data";
  return (root / file).string();
}

TemporaryFolder::TemporaryFolder() {
  std::string pattern = (fs::temp_directory_path() / "selenograph-test-XXXXXX").string();
  if (!mkdtemp(pattern.data())) throw std::runtime_error("no temporary folder");
  path_ = pattern;
}

TemporaryFolder::~TemporaryFolder() {
  std::error_code ignored;
  fs::remove_all(path_, ignored);
}

}  // namespace selenograph::test
