// Craters and rocks in a frame as annotations in the COCO data format (https://cocodataset.org/#format-data), on which
// object detectors are trained, and as masks.
//
//   COCO's pixel coordinates            run-length encoding of a rock's mask: column by column,
//   (0,0)+---+---+                      alternating counts of pixels outside and inside
//        | . | . |  . = pixel centre      . # .     columns: ...  ##.  .#.
//        +---+---+      (0.5, 0.5)        . # #     counts:  3 2 2 1 1
//        | . | . |                        . . .
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "api/requests/frame_json.h"
#include "engine/frame/frame.h"

namespace selenograph::api {

// Returns COCO's list of categories: crater is 1, rock 2.
OrderedJson coco_categories();
// Name of the member of an .npz that holds a frame's annotations.
inline constexpr const char* kCocoMember = "coco.json";

// A point in COCO's coordinates, and a closed outline.
struct ImageCorner {
  double x, y;
};
using ImagePolygon = std::vector<ImageCorner>;

// Labels of a frame of one camera. Craters have outlines, clipped at the image's border; rocks have the pixels that see
// them.
class FrameLabels {
 public:
  // `frame` must have craters and the product kRock, and outlive the labels. Rocks are listed if they cover at least as
  // many pixels as a circle of diameter `min_diameter_px`. Craters come first, then rocks, each the largest first.
  FrameLabels(const engine::Frame& frame, const engine::Camera& camera, double min_diameter_px);

  std::size_t craters() const { return craters_.size(); }
  std::size_t rocks() const { return rocks_.size(); }

  // Returns a document of one image, in a file called `image`. The ids of annotations count from 1. Properties that
  // COCO does not define are additional members of the annotations, which COCO's readers ignore.
  OrderedJson coco(const FrameQuery& query, const std::string& image) const;

  // Return height x width pixels with the id of an annotation, 0 without one. A crater has the pixels whose centres are
  // within its outline; where craters overlap, the smallest one wins. Throw RequestError if there are more ids than a
  // pixel can hold.
  std::vector<std::uint16_t> crater_mask() const;
  std::vector<std::uint16_t> rock_mask() const;

 private:
  struct Crater {
    const engine::CraterRim& rim;
    ImagePolygon polygon;
    double area;
  };
  // Run-length encoded mask of the pixels that see a rock, in COCO's order: column after column, from the top.
  struct Mask {
    std::vector<std::size_t> runs{};               // alternating numbers of pixels outside and inside the mask
    std::size_t past_last = 0;                     // index after the last pixel inside, in COCO's order
    std::size_t area = 0;                          // number of pixels inside
    int left = 0, right = 0, top = 0, bottom = 0;  // outermost columns and rows with pixels inside
    // Adds the pixel in column x and row y, whose index in COCO's order is x * height + y. Indices must rise.
    void add(int x, int y, std::size_t index);
  };
  struct Rock {
    std::size_t number;  // index into the frame's list of rocks
    Mask mask;
  };

  static OrderedJson annotation(const Crater& crater);
  OrderedJson annotation(const Rock& rock) const;
  std::vector<Mask> masks_of_rocks() const;
  std::size_t pixels() const;
  void check_ids() const;

  const engine::Frame& frame_;
  const engine::Camera& camera_;
  std::vector<Crater> craters_;
  std::vector<Rock> rocks_;
};

}  // namespace selenograph::api
