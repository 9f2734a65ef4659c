// Products as named arrays: the one table of products of frames and maps, and the views that the encoders take.
#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <string_view>
#include <variant>
#include <vector>

#include "api/encode/encode.h"
#include "engine/frame/frame.h"
#include "engine/frame/request.h"

namespace selenograph::api {

// Where a frame has a product's elements, whose type is the product's.
using ProductElements =
    std::variant<std::vector<std::uint16_t> engine::FrameProducts::*, std::vector<float> engine::FrameProducts::*,
                 std::vector<double> engine::FrameProducts::*>;

// A product among those of maps.
struct MapPlace {
  int place = 0;  // its place in their order, from 1; 0: maps do not have it
  std::string_view unit{};
  std::string_view meaning{};
};

struct ProductRow {
  engine::Product product;
  std::string_view name;  // as in requests, .npz members and channel names: "radiance"
  ProductElements elements;
  std::span<const std::string_view> components;  // behind the dot in channel names; empty: one channel
  bool needs_sun;
  std::string_view meaning;  // unit, and the value where nothing is hit; empty: frames do not have it
  MapPlace of_maps{};
};

// Every product of frames, in the order of the contract's table. What a product is stands here and nowhere else in
// api/.
std::span<const ProductRow> products();
// Those of maps, in their own order; `meaning` is what is said about maps.
std::span<const ProductRow> map_products();

// "float64 x 3"; an image is "uint8 or uint16".
std::string type_text(const ProductRow& row);

// "position.x" and on, or the product's name.
std::vector<std::string> channel_names(const ProductRow& row);

// Of the arrays of these products.
std::size_t bytes_per_pixel(engine::ProductSet products);

// Elements that the engine has in another type than the answer: an 8-bit image, positions relative to an origin.
struct Narrowed {
  std::vector<std::uint8_t> image;
  std::vector<float> position;
};

std::string_view name_of(engine::Product product);

// The wanted products in the table's order, whatever the order of asking. The views point into `frame` and
// `narrowed`, which is filled here: both must outlive them. Throws std::logic_error if the frame lacks a product or has
// it in another size than the request says.
std::vector<ArrayView> arrays_of(const engine::Frame& frame, const engine::FrameRequest& request,
                                 engine::ProductSet wanted, Narrowed& narrowed);
// The same of a map's products, in maps' order.
std::vector<ArrayView> map_arrays_of(const engine::FrameProducts& products, engine::ProductSet wanted, int height,
                                     int width);

}  // namespace selenograph::api
