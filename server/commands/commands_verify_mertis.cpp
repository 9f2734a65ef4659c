// `selenograph verify mertis`: tabulates the signals of a thermal imaging spectrometer for blackbodies.
#include <fmt/format.h>

#include <filesystem>
#include <stdexcept>

#include "api/requests/mertis_json.h"
#include "dem/files/files.h"
#include "server/commands/commands.h"
#include "server/commands/output.h"
#include "server/commands/request_file.h"

namespace selenograph::server {
namespace {

namespace fs = std::filesystem;

// Returns the instrument in a file, by default MERTIS. Throws std::runtime_error with all faults of the file.
api::MertisQuery read_instrument(const std::string& path) {
  if (path.empty()) return {};
  const std::string text = dem::read_whole(path);
  try {
    return api::read_mertis(api::parse_json(text, 8));
  } catch (const api::RequestError& e) {
    throw std::runtime_error(path + ": " + with_findings(e));
  }
}

}  // namespace

int verify_mertis(const VerifyMertisSettings& settings) {
  const api::MertisQuery query = read_instrument(settings.instrument);
  const fs::path folder = settings.output;
  fs::create_directories(folder);
  write_json((folder / "mertis.json").string(), api::mertis_answer().write({query, {}}));
  fmt::print("{:>14}{:>12}{:>16}{:>16}\n", "temperature K", "channels", "smallest SNR", "largest SNR");
  for (const double kelvin : query.temperatures_k) {
    double smallest_snr = 1e300, largest_snr = 0;
    for (const auto& channel : engine::look_at_blackbody(query.spectrometer, kelvin)) {
      smallest_snr = std::min(smallest_snr, channel.signal_to_noise);
      largest_snr = std::max(largest_snr, channel.signal_to_noise);
    }
    fmt::print("{:>14g}{:>12}{:>16.1f}{:>16.1f}\n", kelvin, query.spectrometer.channels, smallest_snr, largest_snr);
  }
  fmt::print("{0}: mertis.json; picture: deploy/plot {0}\n", settings.output);
  return 0;
}

}  // namespace selenograph::server
