// A frame's products as named arrays: the one table of product names, and the views that the encoders take.
#pragma once

#include <cstdint>
#include <span>
#include <string_view>
#include <vector>

#include "api/encode.h"
#include "engine/frame/frame.h"
#include "engine/frame/request.h"

namespace selenograph::api {

struct ProductName {
  engine::Product product;
  std::string_view name;  // as in requests, .npz members and channel names: "radiance"
};

// Every product, in the order of the contract's table.
std::span<const ProductName> product_names();

std::string_view name_of(engine::Product product);

// The wanted products in the table's order, whatever the order of asking. The views point into `frame` and, for an
// 8-bit image, into `narrowed`, which is filled here (the engine counts in 16 bits): both must outlive them. Throws
// std::logic_error if the frame lacks a product or has it in another size than the request's camera.
std::vector<ArrayView> arrays_of(const engine::Frame& frame, const engine::FrameRequest& request,
                                 engine::ProductSet wanted, std::vector<std::uint8_t>& narrowed);

}  // namespace selenograph::api
