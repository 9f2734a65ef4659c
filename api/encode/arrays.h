// Products as named arrays: the single table of the products of frames and maps, and the views that the encoders take.
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

// Pointer to the member of FrameProducts that holds a product; its type is the element type.
using ProductElements =
    std::variant<std::vector<std::uint16_t> engine::FrameProducts::*, std::vector<float> engine::FrameProducts::*,
                 std::vector<double> engine::FrameProducts::*>;

// Description of a product in maps.
struct MapProduct {
  int order = 0;  // position among the products of maps, from 1; 0: not available in maps
  std::string_view unit{};
  std::string_view meaning{};
};

// A row of the table of products: an array per pixel, of frames, of maps or of both.
struct ProductRow {
  engine::Product product;
  std::string_view name;  // name in requests, .npz members and channel names: "radiance"
  ProductElements elements;
  std::span<const std::string_view> components;  // suffixes of channel names; empty: one channel
  bool needs_sun;
  std::string_view meaning;  // unit, and the value where nothing is hit; empty: not a product of frames
  MapProduct in_maps{};
};

// Returns all products of frames, in the order of the API's table. This is the only definition of products in api/.
std::span<const ProductRow> products();
// Returns the products of maps, in their own order; `meaning` is the one for maps.
std::span<const ProductRow> map_products();

// Returns the element type as text: "float64 x 3"; "uint8 or uint16" for an image.
std::string type_text(const ProductRow& row);

// Returns "position.x" etc. for a product with components, else the product's name.
std::vector<std::string> channel_names(const ProductRow& row);

// Returns the bytes per pixel of these products' arrays.
std::size_t bytes_per_pixel(engine::ProductSet products);

// A float of 16 bits (IEEE 754).
struct Half {
  std::uint16_t bits;
};

// Storage for elements whose type in the answer differs from the engine's: 8-bit images, positions relative to an
// origin, distances as the truth grid says.
struct Narrowed {
  std::vector<std::uint8_t> image;
  std::vector<float> position, depth, range;
  std::vector<Half> half_depth, half_range;
};

std::string_view name_of(engine::Product product);

// Returns views of these products in the table's order. They point into `frame` and `narrowed`, which is filled here;
// both must outlive the views. Throws std::logic_error if the frame lacks a product or has it in a size that differs
// from the request.
std::vector<ArrayView> arrays_of(const engine::Frame& frame, const engine::FrameRequest& request,
                                 engine::ProductSet requested, Narrowed& narrowed);
// Returns views of a map's products, in the order of map_products().
std::vector<ArrayView> map_arrays_of(const engine::FrameProducts& products, engine::ProductSet requested, int height,
                                     int width);

}  // namespace selenograph::api
