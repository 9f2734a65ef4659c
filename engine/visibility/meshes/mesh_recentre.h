// A mesh file's own words moved to the middle of its mesh, in double, before a library reads them as float: 0.1 m of
// coordinates around 1e6 m would be lost.
#pragma once

#include <string>

#include "dem/grid/geodesy.h"

namespace selenograph::engine {

struct Recentred {
  std::string content;
  Vec3 origin = Vec3::Zero();  // what was subtracted
  // By how much the numbers in the file itself may have been rounded: not known better than float. 0: written as double
  // or text.
  double rounding = 0;
};

// By extension: "obj" (lines "v x y z"), "ply" (ascii or binary, x, y and z of its vertices), "gltf" and "glb" (the
// root nodes' translations: glTF's own coordinates are float). What is close to its origin already, or isn't
// understood, comes back as it was: the library says what is wrong with it.
Recentred recentred(std::string content, const std::string& extension);

}  // namespace selenograph::engine
