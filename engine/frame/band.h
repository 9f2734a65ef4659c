// Spectral channels: SENSOR++ (Paproth et al.), section 2.2. Wavelengths in micrometres. Integrals over them are in
// radiometry/spectrum.h.
#pragma once

#include <vector>

namespace selenograph::engine {

struct ResponsePoint {
  double wavelength_um;
  double response;  // 0 to 1
};

// A spectral channel: linear between the points of its response curve, 0 outside.
class Band {
 public:
  // A response of 1 from center - width / 2 to center + width / 2. Throws ImpossibleRequest unless 0 < width < 2
  // center.
  Band(double center_um, double width_um);
  // Throws ImpossibleRequest unless there are at least two points, at increasing wavelengths above 0, with non-negative
  // responses that are not all 0.
  explicit Band(std::vector<ResponsePoint> response);

  const std::vector<ResponsePoint>& response() const { return response_; }
  // Centroid and integral of the response: lambda and Delta lambda of eqs. (8) and (9), um.
  double center_um() const { return center_um_; }
  double width_um() const { return width_um_; }
  double response_at(double wavelength_um) const;
  // Returns the curve's wavelengths and the table's wavelengths between them, increasing.
  std::vector<double> breakpoints(const std::vector<double>& table_um = {}) const;

 private:
  void measure();

  std::vector<ResponsePoint> response_;
  double center_um_ = 0, width_um_ = 0;
};

}  // namespace selenograph::engine
