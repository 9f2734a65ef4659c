#include "dem/gdal/vrt_sources.h"

#include <cpl_conv.h>
#include <cpl_minixml.h>
#include <fmt/format.h>

#include <algorithm>
#include <cstddef>
#include <cstdlib>
#include <filesystem>
#include <iterator>
#include <memory>
#include <string_view>
#include <vector>

#include "dem/base/error.h"
#include "dem/files/files.h"
#include "dem/gdal/library.h"
#include "dem/gdal/remote_names.h"

namespace selenograph::dem {
namespace {

namespace fs = std::filesystem;

// GDAL looks through all sources at each read, and opens them again and again.
constexpr int kMostSources = 10000;
constexpr std::size_t kLongest_bytes = std::size_t{64} << 20;  // of all the VRTs together
constexpr int kDeepest = 8;                                    // VRTs in VRTs; those that name each other have no end
constexpr double kWarpMemory_bytes = 256e6;

// These compute a pixel from all sources, or from any number of pixels: their memory and time know no bound.
constexpr std::string_view kUnbounded[] = {"PixelFunctionType", "PixelFunctionCode", "KernelFilteredSource",
                                           "PansharpeningOptions"};

// These make other values of samples.
constexpr std::string_view kRescaling[] = {"ScaleRatio", "ScaleOffset", "Exponent", "LUT"};

bool is(const CPLXMLNode& node, std::string_view name) { return EQUAL(node.pszValue, std::string(name).c_str()); }

bool is_elsewhere(std::string_view name) {
  return !is_allowed(name) && (name.starts_with("/vsi") || name.find("://") != std::string_view::npos);
}

class Walk {
 public:
  explicit Walk(const std::string& root) : root_(root) {}

  void look_into(const std::string& path, int depth) {
    constexpr std::size_t kLooksLikeIt = 4096;
    if (read_head(path, kLooksLikeIt).find("<VRTDataset") == std::string::npos) {
      if (depth > 0) found_.files.insert(path);
      return;
    }
    if (depth >= kDeepest)
      refuse(fmt::format("has VRTs within VRTs more than {} deep, or such as name each other", kDeepest));
    const std::string text = read_head(path, kLongest_bytes + 1);
    bytes_ += text.size();
    if (bytes_ > kLongest_bytes)
      refuse(fmt::format("is too large: a VRT, with those among its sources, may have {} MiB", kLongest_bytes >> 20));
    const QuietGdal quiet;
    const std::unique_ptr<CPLXMLNode, void (*)(CPLXMLNode*)> tree(CPLParseXMLString(text.c_str()), CPLDestroyXMLNode);
    // Not by recursion: elements may be nested as deeply as the file is long.
    std::vector<const CPLXMLNode*> left{tree.get()};
    while (!left.empty()) {
      const CPLXMLNode* node = left.back();
      left.pop_back();
      if (!node) continue;
      left.push_back(node->psNext);
      left.push_back(node->psChild);
      if (node->eType == CXT_Element) check(*node, path, depth);
    }
  }

  VrtSources found() && { return std::move(found_); }

 private:
  [[noreturn]] void refuse(const std::string& why) const { throw DataError(root_, why); }

  void check(const CPLXMLNode& node, const std::string& vrt, int depth) {
    if (is(node, "SourceFilename") || is(node, "SourceDataset")) add(node, vrt, depth);
    const auto named = [&](std::string_view name) { return is(node, name); };
    found_.rescales |= std::any_of(std::begin(kRescaling), std::end(kRescaling), named);
    const auto unbounded = std::find_if(std::begin(kUnbounded), std::end(kUnbounded), named);
    if (unbounded != std::end(kUnbounded)) refuse(fmt::format("its element {} is not supported", *unbounded));
    if (is(node, "WarpMemoryLimit") && !(CPLAtof(CPLGetXMLValue(&node, nullptr, "0")) <= kWarpMemory_bytes))
      refuse(fmt::format("its WarpMemoryLimit is more than {:.0f} MB", kWarpMemory_bytes / 1e6));
  }

  void add(const CPLXMLNode& node, const std::string& vrt, int depth) {
    const std::string name = CPLGetXMLValue(&node, nullptr, "");
    if (++sources_ > kMostSources)
      refuse(fmt::format("has more than {} sources: make several of it, or one GeoTIFF", kMostSources));
    if (is_allowed(name)) {
      found_.remote = true;
      return;
    }
    std::string file = name;
    if (std::atoi(CPLGetXMLValue(&node, "relativeToVRT", "0")) != 0)
      file = CPLProjectRelativeFilename(fs::weakly_canonical(vrt).parent_path().c_str(), name.c_str());
    std::error_code error;
    const fs::file_status status = fs::status(file, error);
    const bool there = fs::exists(status);
    // What is none, GDAL may take for XML, or for a part of a file.
    if (is_elsewhere(name) || (!there && name.find_first_of("<:") != std::string::npos))
      refuse("its source " + name + " is not a file on this machine");
    if (!there) {
      found_.missing.insert(file);
      return;
    }
    // Those of /proc have no size, and may be waited for like FIFOs.
    if (!fs::is_regular_file(status) || fs::file_size(file, error) == 0)
      refuse("its source " + name + " is not a regular file with content");
    look_into(file, depth + 1);
  }

  const std::string& root_;
  VrtSources found_;
  int sources_ = 0;
  std::size_t bytes_ = 0;
};

}  // namespace

VrtSources vrt_sources(const std::string& path) {
  Walk walk(path);
  walk.look_into(path, 0);
  return std::move(walk).found();
}

}  // namespace selenograph::dem
