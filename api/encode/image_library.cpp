#include "api/encode/image_library.h"

#include <dlfcn.h>

#include <stdexcept>

namespace selenograph::api {

const ImageLibrary& image_library() {
  // Never closed: it is in use until the program ends.
  static const ImageLibrary& library = []() -> const ImageLibrary& {
    void* const file = dlopen("libselenograph_images.so", RTLD_NOW | RTLD_LOCAL);
    const void* const table = file ? dlsym(file, "selenograph_image_library") : nullptr;
    if (!table) throw std::runtime_error(std::string("the library of image formats cannot be loaded: ") + dlerror());
    return *static_cast<const ImageLibrary*>(table);
  }();
  return library;
}

std::string encode_png(const ArrayView& array, const Attributes& attributes, const StopToken& stop) {
  return image_library().png(array, attributes, stop);
}

std::string encode_tiff(const ArrayView& array, const Attributes& attributes, const StopToken& stop) {
  return image_library().tiff(array, attributes, stop);
}

std::string encode_exr(const std::vector<ArrayView>& arrays, const Attributes& attributes, const StopToken& stop) {
  return image_library().exr(arrays, attributes, stop);
}

}  // namespace selenograph::api
