#include "api/arrays.h"

#include <algorithm>
#include <array>
#include <stdexcept>
#include <string>

namespace selenograph::api {
namespace {

constexpr std::array<ProductName, 12> kProducts = {{
    {engine::kImage, "image"},
    {engine::kRadiance, "radiance"},
    {engine::kDepth, "depth"},
    {engine::kRange, "range"},
    {engine::kPosition, "position"},
    {engine::kGeodetic, "geodetic"},
    {engine::kNormal, "normal"},
    {engine::kAngles, "angles"},
    {engine::kLit, "lit"},
    {engine::kGsd, "gsd"},
    {engine::kSource, "source"},
    {engine::kObjectId, "object_id"},
}};

ElementType type_of(const std::vector<std::uint8_t>&) { return ElementType::uint8; }
ElementType type_of(const std::vector<std::uint16_t>&) { return ElementType::uint16; }
ElementType type_of(const std::vector<float>&) { return ElementType::float32; }
ElementType type_of(const std::vector<double>&) { return ElementType::float64; }

// Components are the names behind the dot; without any the array has the product's name for its only channel.
template <typename Element>
ArrayView view(engine::Product product, const std::vector<Element>& data, const engine::Camera& camera,
               const std::vector<std::string>& components = {}) {
  const std::string name(name_of(product));
  const std::size_t channels = std::max<std::size_t>(components.size(), 1);
  const std::size_t expected = std::size_t(camera.height) * std::size_t(camera.width) * channels;
  if (data.size() != expected) {
    throw std::logic_error("the frame has " + std::to_string(data.size()) + " elements of " + name + ", not " +
                           std::to_string(expected));
  }
  std::vector<std::string> channel_names;
  channel_names.reserve(components.size() + 1);
  for (const std::string& component : components) channel_names.push_back(name + "." + component);
  if (components.empty()) channel_names.push_back(name);
  return {name_of(product), type_of(data), camera.height, camera.width, int(channels), data.data(), channel_names};
}

ArrayView view_of(engine::Product product, const engine::Frame& frame, const engine::FrameRequest& request,
                  std::vector<std::uint8_t>& narrowed) {
  const engine::FrameProducts& p = frame.products;
  const engine::Camera& camera = request.camera;
  switch (product) {
    case engine::kImage:
      if (image_bits(request) != 8) return view(product, p.image, camera);
      narrowed.resize(p.image.size());
      std::transform(p.image.begin(), p.image.end(), narrowed.begin(),
                     [](std::uint16_t number) { return static_cast<std::uint8_t>(number); });
      return view(product, narrowed, camera);
    case engine::kRadiance:
      return view(product, p.radiance, camera);
    case engine::kDepth:
      return view(product, p.depth, camera);
    case engine::kRange:
      return view(product, p.range, camera);
    case engine::kPosition:
      return view(product, p.position, camera, {"x", "y", "z"});
    case engine::kGeodetic:
      return view(product, p.geodetic, camera, {"lat_deg", "lon_deg", "height_m"});
    case engine::kNormal:
      return view(product, p.normal, camera, {"x", "y", "z"});
    case engine::kAngles:
      return view(product, p.angles, camera, {"incidence_deg", "emission_deg", "phase_deg"});
    case engine::kLit:
      return view(product, p.lit, camera);
    case engine::kGsd:
      return view(product, p.gsd, camera);
    case engine::kSource:
      return view(product, p.source, camera);
    case engine::kObjectId:
      return view(product, p.object_id, camera);
  }
  throw std::logic_error("unknown product");
}

}  // namespace

std::span<const ProductName> product_names() { return kProducts; }

std::string_view name_of(engine::Product product) {
  for (const ProductName& entry : kProducts) {
    if (entry.product == product) return entry.name;
  }
  throw std::logic_error("unknown product");
}

std::vector<ArrayView> arrays_of(const engine::Frame& frame, const engine::FrameRequest& request,
                                 engine::ProductSet wanted, std::vector<std::uint8_t>& narrowed) {
  std::vector<ArrayView> arrays;
  for (const ProductName& entry : kProducts) {
    if (wanted & entry.product) arrays.push_back(view_of(entry.product, frame, request, narrowed));
  }
  return arrays;
}

}  // namespace selenograph::api
