// A catalogue of stars, searched by field.
#pragma once

#include <cstddef>
#include <cstdint>
#include <limits>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "dem/base/stop_token.h"
#include "dem/grid/geodesy.h"

namespace selenograph::engine {

// A row of a catalogue file.
struct StarRow {
  std::string id;                      // "HR 1713"
  double ra_deg, dec_deg;              // ICRS, at epoch_yr
  double epoch_yr;                     // Julian year
  double pm_ra_mas_yr, pm_dec_mas_yr;  // proper motion; in right ascension with the factor cos(dec)
  double parallax_mas;
  double v_mag, b_v;  // Johnson V and B - V
};

struct Star {
  // ICRS direction from the Solar System's barycentre at J2000.0: a unit vector at the catalogue's epoch, moved along a
  // straight line by the proper motion since then. Therefore not exactly of unit length.
  Vec3 position;
  Vec3f motion_rad_yr;
  float parallax_rad, v_mag, b_v;
};

// Stars are stored in cells of 2 degrees, sorted by magnitude within a cell. A search visits only the cells that
// intersect the field, and in each only the stars above the magnitude limit.
class StarCatalogue {
 public:
  // Reads a CSV file whose first line that is not a comment (#) is
  //   id,ra_deg,dec_deg,epoch_yr,pm_ra_mas_yr,pm_dec_mas_yr,parallax_mas,v_mag,b_v
  // followed by one row per star. The catalogue's name is the file's, without folder and extension. Throws DataError
  // naming file and line, also when reading takes more than `max_bytes` of memory (160 bytes per star and two per byte
  // of the file); Cancelled when stopped.
  static StarCatalogue read(const std::string& path, std::size_t max_bytes = std::numeric_limits<std::size_t>::max(),
                            const StopToken& stop = {});

  StarCatalogue(std::string name, const std::vector<StarRow>& rows);

  const std::string& name() const { return name_; }
  std::size_t size() const { return stars_.size(); }
  std::size_t bytes() const;  // memory in use
  const Star& star(std::uint32_t index) const { return stars_[index]; }
  std::string_view id(std::uint32_t index) const;
  // Returns a hash of all rows.
  std::uint64_t fingerprint() const { return fingerprint_; }

  // Returns the indices of the stars up to a V magnitude whose position at J2000.0 is within a radius of a direction
  // (unit, ICRS). Their order depends only on the catalogue.
  std::vector<std::uint32_t> within(const Vec3& direction, double radius_rad, double magnitude_limit) const;
  // Returns an upper bound on the stars' motion since J2000.0.
  double largest_motion_rad(double years) const;

 private:
  struct Cell {
    Vec3 centre;  // unit
    double radius_rad;
    std::uint32_t first, past_last;
  };

  std::string name_;
  std::vector<Star> stars_;             // sorted by cell, then by magnitude
  std::string ids_;                     // all identifiers, concatenated
  std::vector<std::uint32_t> id_ends_;  // end of each star's identifier in ids_
  std::vector<Cell> cells_;
  double fastest_rad_yr_ = 0;
  std::uint64_t fingerprint_ = 0;
};

}  // namespace selenograph::engine
