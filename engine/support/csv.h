// CSV files of numbers, as users keep tables in.
#pragma once

#include <functional>
#include <stdexcept>
#include <string>
#include <string_view>
#include <vector>

namespace selenograph::engine {

// What is wrong with one line of a file.
class BadLine : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

// Calls each(line) for the lines that are neither empty nor comments (#). What `each` throws as BadLine becomes
// DataError with the file's name and the line's number; so does a file that can't be read.
void each_csv_line(const std::string& path, const std::function<void(std::string_view line)>& each);

// Numbers separated by commas. Throws BadLine when something else is in the line.
std::vector<double> csv_numbers(std::string_view line);

}  // namespace selenograph::engine
