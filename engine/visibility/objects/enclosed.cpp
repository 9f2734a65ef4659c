#include "engine/visibility/objects/enclosed.h"

#include <fmt/format.h>

#include <cmath>
#include <numbers>
#include <optional>

#include "dem/base/error.h"
#include "dem/detail/detailed_terrain.h"
#include "dem/detail/footprints.h"
#include "dem/detail/rocks_on_ground.h"
#include "engine/visibility/objects/object_mesh.h"
#include "engine/visibility/objects/rock_shapes.h"

namespace selenograph::engine {
namespace {

constexpr double kMinWinding = 0.9;  // smallest absolute winding number that counts as inside

bool encloses(const ObjectMesh& mesh, const Vec3& point) {
  if ((point - mesh.centre()).norm() > mesh.radius()) return false;
  return std::abs(winding_number(mesh.shape(), point)) >= kMinWinding;
}

// Returns the diameter of a rock that encloses a position.
std::optional<double> rock_around(const dem::Terrain& terrain, const Vec3& position_m, const StopToken& stop) {
  if (!terrain.detailed() || terrain.detailed()->detail().rocks().empty()) return std::nullopt;
  const double largest_m = terrain.detailed()->detail().rocks().law().largest_m;
  const Geographic g = to_geographic(position_m);
  // Return early high above all ground, before the finest ground below is made.
  if (g.height_m > double{dem::kHighestRelief_m} + 2 * largest_m) return std::nullopt;
  const double above_m = g.height_m - terrain.height(g.lat_deg, g.lon_deg, stop).height_m;
  // A rock lies within a diameter of its position (rock_shapes.h).
  if (!(above_m < 2 * largest_m)) return std::nullopt;
  const dem::RockSurvey survey(terrain);
  const dem::RockField& field = survey.field();
  std::vector<dem::RockFeature> rocks;
  for (int octave = field.smallest_octave(); octave <= field.largest_octave(); ++octave)
    survey.add(octave, dem::around({g.lat_deg, g.lat_deg, g.lon_deg, g.lon_deg}, field.largest_m(octave)),
               field.law().smallest_m, rocks, stop);
  for (const dem::RockFeature& rock : rocks) {
    if ((position_m - rock.position_m).norm() > rock.rock.diameter_m) continue;
    const PlacedShape placed = placed_rock(rock.rock, rock.up);
    if (encloses(*placed.mesh, placed.from_mesh.inverse() * (position_m - rock.position_m)))
      return rock.rock.diameter_m;
  }
  return std::nullopt;
}

}  // namespace

// Sums the solid angles of the triangles (van Oosterom and Strackee 1983): atan2 gives half of each.
double winding_number(const ObjectShape& shape, const Vec3& point) {
  double half_angles = 0;
  for (const ObjectTriangle& t : shape.triangles) {
    const Vec3 a = shape.place(t, 0) - point, b = shape.place(t, 1) - point, c = shape.place(t, 2) - point;
    const double length_a = a.norm();
    const double length_b = b.norm();
    const double length_c = c.norm();
    half_angles += std::atan2(a.dot(b.cross(c)), length_a * length_b * length_c + a.dot(b) * length_c +
                                                     b.dot(c) * length_a + c.dot(a) * length_b);
  }
  return half_angles / (2 * std::numbers::pi);
}

void refuse_enclosed(const dem::Terrain* terrain, const std::vector<SceneObject>& objects, const Vec3& position_m,
                     const std::string& subject, const StopToken& stop) {
  for (std::size_t i = 0; i < objects.size(); ++i) {
    stop.check();
    const SceneObject& object = objects[i];
    if (encloses(*object.mesh, object.moon_from_object.conjugate() * (position_m - object.position_m) / object.scale))
      throw ImpossibleRequest(fmt::format("{} is inside objects/{}, whose mesh is closed: move it out, or cut the mesh "
                                          "open where it looks out",
                                          subject, i),
                              "");
  }
  if (!terrain) return;
  if (const auto diameter_m = rock_around(*terrain, position_m, stop))
    throw ImpossibleRequest(
        fmt::format("{} is inside a rock of {:.2f} m of the detail: move it out, or choose a detail "
                    "without rocks",
                    subject, *diameter_m),
        "");
}

void refuse_enclosed(const dem::Terrain* terrain, const std::vector<SceneObject>& objects, const RowViews& views,
                     const StopToken& stop) {
  if (!views.vary()) return refuse_enclosed(terrain, objects, views.reference().position(), "the camera", stop);
  const auto rows = static_cast<std::size_t>(views.height());
  const std::size_t sample_count = std::min(rows, kMaxCameraPlaces);
  for (std::size_t k = 0; k < sample_count; ++k) {
    const auto row = static_cast<int>(sample_count == 1 ? 0 : k * (rows - 1) / (sample_count - 1));
    refuse_enclosed(terrain, objects, views.of(row).position(), fmt::format("in row {} the camera", row), stop);
  }
}

}  // namespace selenograph::engine
