#include "engine/support/csv.h"

#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <fstream>

#include "dem/base/error.h"
#include "dem/files/files.h"

namespace selenograph::engine {

void each_csv_line(const std::string& path, const std::function<void(std::string_view)>& each, const StopToken& stop) {
  constexpr int kLinesBetweenChecks = 1024;
  // Reject a FIFO: opening it would wait for its writer.
  if (!dem::file_state(path)) throw DataError(path, "is missing or not a file");
  std::ifstream file(path);
  if (!file) throw DataError(path, "cannot be read");
  std::string line;
  for (int number = 1; std::getline(file, line); ++number) {
    if (number % kLinesBetweenChecks == 0) stop.check();
    if (!line.empty() && line.back() == '\r') line.pop_back();
    if (line.empty() || line.front() == '#') continue;
    try {
      each(line);
    } catch (const BadLine& e) {
      throw DataError(path, fmt::format("line {}: {}", number, e.what()));
    }
  }
  if (file.bad()) throw DataError(path, "cannot be read to its end");
}

std::vector<double> csv_numbers(std::string_view line) {
  std::vector<double> numbers;
  const char* at = line.data();
  const char* const end = line.data() + line.size();
  for (;;) {
    double number = 0;
    const auto [next, error] = std::from_chars(at, end, number);
    if (error != std::errc() || (next != end && *next != ','))
      throw BadLine("numbers separated by commas are expected");
    numbers.push_back(number);
    if (next == end) return numbers;
    at = next + 1;
  }
}

std::vector<std::vector<double>> csv_rows(std::string_view text) {
  std::vector<std::vector<double>> rows;
  // Skip the header.
  for (std::size_t at = text.find('\n') + 1; at < text.size();) {
    const std::size_t end = std::min(text.find('\n', at), text.size());
    rows.push_back(csv_numbers(text.substr(at, end - at)));
    at = end + 1;
  }
  return rows;
}

}  // namespace selenograph::engine
