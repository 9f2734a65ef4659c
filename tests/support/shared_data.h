// Real lunar data beside the project, where it is present.
#pragma once

#include <gtest/gtest.h>

#include <filesystem>
#include <string>

namespace selenograph::test {

// Returns the path of a file in $SELENOGRAPH_SHARED_DATA, else in ../shared/data beside the source tree.
std::string shared_data(const std::string& file);

// A folder that belongs to one test and is removed on destruction.
class TemporaryFolder {
 public:
  TemporaryFolder();
  ~TemporaryFolder();
  TemporaryFolder(const TemporaryFolder&) = delete;
  TemporaryFolder& operator=(const TemporaryFolder&) = delete;
  const std::string& path() const { return path_; }
  std::string operator/(const std::string& name) const { return path_ + "/" + name; }

 private:
  std::string path_;
};

}  // namespace selenograph::test

#define SELENOGRAPH_SKIP_WITHOUT(path) \
  if (!std::filesystem::exists(path)) GTEST_SKIP() << path << " is not here (set SELENOGRAPH_SHARED_DATA)"
