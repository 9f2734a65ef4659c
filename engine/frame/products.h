// Per-pixel products of frames and maps.
#pragma once

#include <cstdint>
#include <tuple>
#include <vector>

namespace selenograph::engine {

// Products, in the order of the API's table; values are bits of a set. Maps have some of them, and some of their own.
enum Product : std::uint32_t {
  kImage = 1u << 0,
  kRadiance = 1u << 1,
  kDepth = 1u << 2,
  kRange = 1u << 3,
  kPosition = 1u << 4,
  kGeodetic = 1u << 5,
  kNormal = 1u << 6,
  kAngles = 1u << 7,
  kLit = 1u << 8,
  kGsd = 1u << 9,
  kSource = 1u << 10,
  kObjectId = 1u << 11,
  kDetail = 1u << 12,
  kAlbedo = 1u << 22,
  kIrradiance = 1u << 16,
  kFlow = 1u << 17,
  // Internal: used to list the rocks of a frame.
  kRock = 1u << 13,
  // Maps only.
  kHeight = 1u << 14,
  kSlope = 1u << 15,
  kRockHeight = 1u << 18,
  kRockCover = 1u << 19,
  kRoughness = 1u << 20,
  kHazard = 1u << 21,
};

using ProductSet = std::uint32_t;

// Arrays of height x width (x components), row 0 on top; empty if not requested. The API defines the values of missing
// data. Their order means nothing.
struct FrameProducts {
  std::vector<std::uint16_t> image;  // 8-bit images, too: the encoder converts them
  std::vector<float> radiance;       // W m-2 sr-1, band-integrated over the solar irradiance's band
  std::vector<double> depth, range;  // m
  std::vector<double> position;      // 3 per pixel, MOON_ME m
  std::vector<double> geodetic;      // 3 per pixel: lat_deg, lon_deg, height_m
  std::vector<float> normal;         // 3 per pixel, MOON_ME
  std::vector<float> angles;         // 3 per pixel: incidence, emission, phase, degrees
  std::vector<float> lit;
  std::vector<float> irradiance;  // 3 per pixel, W m-2: direct, from terrain, from the Earth
  std::vector<double> flow;       // 2 per pixel, px: from the pixel to its point in the image at FrameRequest::flow_to
  std::vector<float> gsd;         // m
  std::vector<std::uint16_t> source;
  std::vector<std::uint16_t> object_id;  // index into FrameRequest::objects; 65535: terrain, or nothing
  std::vector<std::uint16_t> detail;     // a dem::Ground; 65535: an object, or nothing
  std::vector<float> albedo;             // of the ground, in the words of its reflectance (radiometry/mapped_surface.h)
  std::vector<std::uint16_t> rock;       // index into Frame::rocks; 65535: none
  std::vector<double> height;            // maps: m above the datum
  std::vector<float> slope;              // maps: degrees between the normal and the datum's vertical
  std::vector<float> rock_height;        // maps: height of a rock's surface above the ground below it, m; 0: no rock
  std::vector<float> rock_cover;         // maps: share of the footprint that rocks cover
  std::vector<float> roughness;          // maps: largest distance of ground in the footprint from its plane, m
  std::vector<std::uint16_t> hazard;     // maps: see Hazard in map.h
};

// Returns references to all arrays of the products. A new array that is not listed here does not compile.
template <typename Products>
auto all_arrays(Products& products) {
  auto& [image, radiance, depth, range, position, geodetic, normal, angles, lit, irradiance, flow, gsd, source,
         object_id, detail, albedo, rock, height, slope, rock_height, rock_cover, roughness, hazard] = products;
  return std::tie(image, radiance, depth, range, position, geodetic, normal, angles, lit, irradiance, flow, gsd, source,
                  object_id, detail, albedo, rock, height, slope, rock_height, rock_cover, roughness, hazard);
}

}  // namespace selenograph::engine
