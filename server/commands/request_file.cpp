#include "server/commands/request_file.h"

#include <fmt/format.h>

#include <cstdio>
#include <fstream>
#include <iostream>
#include <iterator>
#include <nlohmann/json.hpp>
#include <stdexcept>

namespace selenograph::server {

std::string read_request(const std::string& path) {
  if (path == "-") return {std::istreambuf_iterator<char>(std::cin), {}};
  std::ifstream file(path, std::ios::binary);
  file.peek();  // a folder can be opened
  if (!file.is_open() || file.bad()) throw std::runtime_error(path + ": can't be read");
  return {std::istreambuf_iterator<char>(file), {}};
}

void print_problem(const api::Response& answer) {
  const auto problem = nlohmann::json::parse(answer.body, nullptr, false);
  if (!problem.is_object()) {
    fmt::print(stderr, "error: status {}\n", answer.status);
    return;
  }
  fmt::print(stderr, "error: {}: {}\n", problem.value("title", ""), problem.value("detail", ""));
  for (const auto& finding : problem.value("errors", nlohmann::json::array())) {
    fmt::print(stderr, "  {}: {}\n", finding.value("pointer", ""), finding.value("detail", ""));
  }
}

}  // namespace selenograph::server
