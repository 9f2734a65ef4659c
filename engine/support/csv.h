// CSV files of numbers.
#pragma once

#include <functional>
#include <stdexcept>
#include <string>
#include <string_view>
#include <vector>

#include "dem/base/stop_token.h"

namespace selenograph::engine {

// An error in one line of a file.
class BadLine : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

// Calls each(line) for lines that are neither empty nor comments (#). A BadLine thrown by `each` becomes a DataError
// with the file's name and the line's number; so does an unreadable file. Throws Cancelled once `stop` is requested.
void each_csv_line(const std::string& path, const std::function<void(std::string_view line)>& each,
                   const StopToken& stop = {});

// Parses numbers separated by commas. Throws BadLine for anything else in the line.
std::vector<double> csv_numbers(std::string_view line);

// Returns the rows of a table that is part of the executable: a head, and lines of numbers.
std::vector<std::vector<double>> csv_rows(std::string_view text);

}  // namespace selenograph::engine
