#include "engine/frame/band.h"

#include <algorithm>
#include <utility>

#include "dem/base/error.h"
#include "engine/support/interpolate.h"

namespace selenograph::engine {

Band::Band(double center_um, double width_um)
    : response_{{center_um - width_um / 2, 1}, {center_um + width_um / 2, 1}} {
  const double first = response_[0].wavelength_um, last = response_[1].wavelength_um;
  if (!(width_um > 0 && first > 0 && last > first))
    throw ImpossibleRequest("a band's width must be above 0 and below twice its center");
  measure();
}

Band::Band(std::vector<ResponsePoint> response) : response_(std::move(response)) {
  if (response_.size() < 2) throw ImpossibleRequest("a response curve needs two points");
  double before = 0;
  for (const ResponsePoint& p : response_) {
    if (!(p.wavelength_um > before)) throw ImpossibleRequest("a response curve's wavelengths must rise, from above 0");
    if (!(p.response >= 0)) throw ImpossibleRequest("a response must not be negative");
    before = p.wavelength_um;
  }
  measure();
  if (!(width_um_ > 0)) throw ImpossibleRequest("a response curve must not be 0 everywhere");
}

void Band::measure() {
  double moment = 0;
  for (std::size_t i = 0; i + 1 < response_.size(); ++i) {
    const ResponsePoint &a = response_[i], &b = response_[i + 1];
    const double width = b.wavelength_um - a.wavelength_um;
    width_um_ += width * (a.response + b.response) / 2;
    moment += integral_of_product(width, a.response, b.response, a.wavelength_um, b.wavelength_um);
  }
  center_um_ = moment / width_um_;
}

double Band::response_at(double wavelength_um) const {
  if (!(wavelength_um >= response_.front().wavelength_um && wavelength_um <= response_.back().wavelength_um)) return 0;
  const auto s = segment_at(response_, wavelength_um, &ResponsePoint::wavelength_um);
  return s.between(s.a.response, s.b.response);
}

std::vector<double> Band::breakpoints(const std::vector<double>& table_um) const {
  std::vector<double> points;
  for (const ResponsePoint& p : response_) points.push_back(p.wavelength_um);
  for (const double w : table_um)
    if (w > response_.front().wavelength_um && w < response_.back().wavelength_um) points.push_back(w);
  std::sort(points.begin(), points.end());
  points.erase(std::unique(points.begin(), points.end()), points.end());
  return points;
}

}  // namespace selenograph::engine
