// Runs a fuzz target on files, without libFuzzer: the regression run of every build.
// usage: TARGET FILE-OR-FOLDER...
#include <algorithm>
#include <cstdio>
#include <exception>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <string>
#include <vector>

#include "tests/fuzz/fuzz.h"

namespace fs = std::filesystem;

namespace {

std::vector<std::string> files_below(const std::string& path) {
  if (!fs::is_directory(path)) return {path};
  std::vector<std::string> files;
  for (const auto& entry : fs::recursive_directory_iterator(path))
    if (entry.is_regular_file()) files.push_back(entry.path().string());
  std::sort(files.begin(), files.end());
  return files;
}

// From memory of exactly the input's size, so that a sanitizer sees a read past its end.
void run(const std::string& path) {
  std::ifstream file(path, std::ios::binary);
  if (!file) throw fs::filesystem_error("can't be read", path, std::make_error_code(std::errc::io_error));
  const std::vector<char> bytes{std::istreambuf_iterator<char>(file), std::istreambuf_iterator<char>()};
  LLVMFuzzerTestOneInput(reinterpret_cast<const std::uint8_t*>(bytes.data()), bytes.size());
}

}  // namespace

int main(int argc, char** argv) {
  std::size_t inputs = 0;
  std::string now;
  try {
    for (int i = 1; i < argc; ++i)
      for (const std::string& path : files_below(argv[i])) {
        now = path;
        std::fprintf(stderr, "%s\n", path.c_str());  // before it runs: the last line names the one that crashed
        run(path);
        ++inputs;
      }
  } catch (const std::exception& e) {
    std::fprintf(stderr, "%s: thrown out of the target: %s\n", now.c_str(), e.what());
    return 1;
  }
  std::printf("%zu inputs\n", inputs);
  return inputs > 0 ? 0 : 1;  // nothing found means a wrong folder, not success
}
