#include "engine/horizons/illumination.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "dem/base/parallel.h"
#include "engine/frame/sun.h"
#include "engine/sky/ephemeris.h"

namespace selenograph::engine {
namespace {

constexpr double kLimbDarkening = 0.6;  // of the Sun, as in frames
constexpr double kMeanEarthRadius_m = 6371000;

void allocate(std::size_t places, Illumination& out) {
  for (std::vector<float>* values :
       {&out.sun_mean, &out.earth_mean, &out.longest_night_h, &out.nights, &out.longest_without_earth_h})
    values->assign(places, std::numeric_limits<float>::quiet_NaN());
}

// Shares of the Sun and the Earth at sixteen places.
struct PacketLight {
  std::vector<float> sun, earth;
};

// Finds the shares of packets, and stores their statistics.
class IlluminationSearch {
 public:
  IlluminationSearch(const BodySeries& bodies, Illumination& out)
      : bodies_(bodies),
        sun_(bodies.sun),
        earth_(bodies.earth),
        sun_disc_(disc_with(kLimbDarkening)),
        earth_disc_(disc_with(0)),
        out_(out) {}

  PacketLight find(const PacketHorizons& packet) const {
    PacketLight light{std::vector<float>(bodies_.sun.size() * kPacket),
                      std::vector<float>(bodies_.earth.size() * kPacket)};
    find_disc_shares(packet, sun_disc_, sun_, light.sun.data());
    find_disc_shares(packet, earth_disc_, earth_, light.earth.data());
    const DarkRuns sun = find_dark_runs(light.sun), earth = find_dark_runs(light.earth);
    const auto epochs = static_cast<float>(bodies_.sun.size());
    const auto hours = static_cast<float>(bodies_.step_s / 3600);
    for (std::size_t i = 0; i < kPacket; ++i) {
      if (packet.index[i] < 0) continue;
      const auto pixel = static_cast<std::size_t>(packet.index[i]);
      out_.sun_mean[pixel] = sun.sum[i] / epochs;
      out_.earth_mean[pixel] = earth.sum[i] / epochs;
      // Runs count a share without data as dark: the mean, which is NaN then, tells such a place.
      if (std::isnan(sun.sum[i]) || std::isnan(earth.sum[i])) continue;
      out_.longest_night_h[pixel] = sun.longest[i] * hours;
      out_.nights[pixel] = sun.count[i];
      out_.longest_without_earth_h[pixel] = earth.longest[i] * hours;
    }
    return light;
  }

 private:
  const BodySeries& bodies_;
  BodyTrack sun_, earth_;
  Disc sun_disc_, earth_disc_;
  Illumination& out_;
};

}  // namespace

BodySeries bodies_at(const std::vector<std::string>& utc, double step_s) {
  BodySeries series{std::vector<BodyEpoch>(utc.size()), std::vector<BodyEpoch>(utc.size()), step_s};
  in_parallel_pieces(utc.size(), 64, [&](std::size_t first, std::size_t past_last) {
    for (std::size_t i = first; i < past_last; ++i) {
      const SunPosition sun = sun_at(utc[i]);
      const Earth earth = earth_at(utc[i]);
      series.sun[i] = {sun.direction, sun.distance_au * kAstronomicalUnit_m,
                       sun_radius_deg(sun.distance_au) * kRadiansPerDegree};
      series.earth[i] = {earth.direction, earth.distance_m, std::asin(kMeanEarthRadius_m / earth.distance_m)};
    }
  });
  return series;
}

Illumination illumination_of_map(const dem::MapGrid& grid, const HorizonOptions& options, const BodySeries& bodies,
                                 const RenderContext& context, const HorizonProgress& progress) {
  Illumination out;
  allocate(static_cast<std::size_t>(grid.width) * static_cast<std::size_t>(grid.height), out);
  const IlluminationSearch search(bodies, out);
  out.report = find_map_horizons(
      grid, options, context, [&](const PacketHorizons& packet) { search.find(packet); }, progress);
  return out;
}

IlluminationSeries illumination_of_places(std::span<const Vec3> places, const HorizonOptions& options,
                                          const BodySeries& bodies, const RenderContext& context,
                                          const HorizonProgress& progress) {
  IlluminationSeries out;
  allocate(places.size(), out.summary);
  const std::size_t values = bodies.sun.size() * places.size();
  out.sun.assign(values, std::numeric_limits<float>::quiet_NaN());
  out.earth = out.sun;
  const IlluminationSearch search(bodies, out.summary);
  const auto store = [&](const PacketHorizons& packet) {
    const PacketLight light = search.find(packet);
    for (std::size_t lane = 0; lane < kPacket; ++lane) {
      if (packet.index[lane] < 0) continue;
      for (std::size_t e = 0; e < bodies.sun.size(); ++e) {
        const std::size_t to = e * places.size() + static_cast<std::size_t>(packet.index[lane]);
        out.sun[to] = light.sun[e * kPacket + lane];
        out.earth[to] = light.earth[e * kPacket + lane];
      }
    }
  };
  out.summary.report = find_place_horizons(places, options, context, store, progress);
  return out;
}

}  // namespace selenograph::engine
