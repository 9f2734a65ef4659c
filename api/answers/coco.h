// Craters and rocks in a frame as annotations in the COCO data format (https://cocodataset.org/#format-data), on which
// object detectors are trained, and as masks.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "api/requests/frame_json.h"
#include "engine/frame/frame.h"

namespace selenograph::api {

// COCO's list of categories: crater is 1, rock 2.
OrderedJson coco_categories();
// The member of an .npz that holds a frame's annotations.
inline constexpr const char* kCocoMember = "coco.json";

// A place in COCO's coordinates, and an outline.
struct ImageCorner {
  double x, y;
};
using ImagePolygon = std::vector<ImageCorner>;

// Labels of a frame of one camera. COCO's coordinates: the top-left corner of the top-left pixel is (0, 0), its centre
// (0.5, 0.5). Craters have outlines, clipped at the image's border; rocks have the pixels that see them.
class FrameLabels {
 public:
  // `frame`: with craters and product kRock; it must outlive this. Rocks are listed if they cover at least as many
  // pixels as a circle of diameter `least_px`. Craters come first, then rocks, each the largest first.
  FrameLabels(const engine::Frame& frame, const engine::Camera& camera, double least_px);

  std::size_t craters() const { return craters_.size(); }
  std::size_t rocks() const { return rocks_.size(); }

  // A document of one image, in a file called `image`. The ids of annotations count from 1. Properties without a place
  // in COCO are additional members of the annotations, which its readers ignore.
  OrderedJson coco(const FrameQuery& query, const std::string& image) const;

  // Per pixel the id of an annotation, 0 without one; height x width. A crater has the pixels whose centres are within
  // its outline; of several the smallest counts. Throws RequestError if there are more ids than a pixel can hold.
  std::vector<std::uint16_t> crater_mask() const;
  std::vector<std::uint16_t> rock_mask() const;

 private:
  struct Crater {
    const engine::CraterRim& rim;
    ImagePolygon polygon;
    double area;
  };
  // The pixels that see a rock, down one column of the image after the other: COCO's order.
  struct Mask {
    std::vector<std::size_t> runs{};  // of other pixels and its own, in turn
    std::size_t past_last = 0, area = 0;
    int left = 0, right = 0, top = 0, bottom = 0;
    void add(int x, int y, std::size_t at);
  };
  struct Rock {
    std::size_t number;  // in the frame's list
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
