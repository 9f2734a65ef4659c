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

// Limit of sources: GDAL searches all sources at each read, and reopens them.
constexpr int kMaxSources = 10000;
constexpr std::size_t kMaxXml_bytes = std::size_t{64} << 20;  // XML of all nested VRTs together
constexpr int kMaxVrtDepth = 8;  // VRTs in VRTs: VRTs that name each other would have no end
constexpr double kWarpMemory_bytes = 256e6;

// Elements that compute a pixel from all sources, or from any number of pixels: their memory and time are unbounded.
constexpr std::string_view kUnbounded[] = {"PixelFunctionType", "PixelFunctionCode", "KernelFilteredSource",
                                           "PansharpeningOptions"};

// Elements that compute other values from samples.
constexpr std::string_view kRescaling[] = {"ScaleRatio", "ScaleOffset", "Exponent", "LUT"};

bool is(const CPLXMLNode& node, std::string_view name) { return EQUAL(node.pszValue, std::string(name).c_str()); }

// Returns whether a name is of another machine or of a file system of GDAL's that is not allowed.
bool is_elsewhere(std::string_view name) {
  return !is_allowed(name) && (name.starts_with("/vsi") || name.find("://") != std::string_view::npos);
}

// Scans a VRT's XML, and those of nested VRTs, for sources and unsupported elements.
class VrtScan {
 public:
  explicit VrtScan(const std::string& root) : root_(root) {}

  // Scans a file: records it as a source unless it is a VRT; then scans its XML. `depth`: number of VRTs around it.
  void scan(const std::string& path, int depth) {
    constexpr std::size_t kHead_bytes = 4096;  // a VRT's first element lies within these
    if (read_head(path, kHead_bytes).find("<VRTDataset") == std::string::npos) {
      if (depth > 0) result_.files.insert(path);
      return;
    }
    if (depth >= kMaxVrtDepth)
      refuse(fmt::format("has VRTs within VRTs more than {} deep, or such as name each other", kMaxVrtDepth));
    const std::string text = read_head(path, kMaxXml_bytes + 1);
    bytes_ += text.size();
    if (bytes_ > kMaxXml_bytes)
      refuse(fmt::format("is too large: a VRT, with those among its sources, may have {} MiB", kMaxXml_bytes >> 20));
    const QuietGdal quiet;
    const std::unique_ptr<CPLXMLNode, void (*)(CPLXMLNode*)> tree(CPLParseXMLString(text.c_str()), CPLDestroyXMLNode);
    // Traverse with a stack of our own: elements may be nested as deeply as the file is long, too deep for recursion.
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

  VrtSources sources() && { return std::move(result_); }

 private:
  [[noreturn]] void refuse(const std::string& why) const { throw DataError(root_, why); }

  // Refuses an unsupported element, and follows one that names a source.
  void check(const CPLXMLNode& node, const std::string& vrt, int depth) {
    if (is(node, "SourceFilename") || is(node, "SourceDataset")) add(node, vrt, depth);
    const auto named = [&](std::string_view name) { return is(node, name); };
    result_.rescales |= std::any_of(std::begin(kRescaling), std::end(kRescaling), named);
    const auto unbounded = std::find_if(std::begin(kUnbounded), std::end(kUnbounded), named);
    if (unbounded != std::end(kUnbounded)) refuse(fmt::format("its element {} is not supported", *unbounded));
    if (is(node, "WarpMemoryLimit") && !(CPLAtof(CPLGetXMLValue(&node, nullptr, "0")) <= kWarpMemory_bytes))
      refuse(fmt::format("its WarpMemoryLimit is more than {:.0f} MB", kWarpMemory_bytes / 1e6));
  }

  // Records the source that an element names, and scans it if it is a local file.
  void add(const CPLXMLNode& node, const std::string& vrt, int depth) {
    const std::string name = CPLGetXMLValue(&node, nullptr, "");
    if (++sources_ > kMaxSources)
      refuse(fmt::format("has more than {} sources: make several of it, or one GeoTIFF", kMaxSources));
    if (is_allowed(name)) {
      result_.files.insert(name);
      return;
    }
    std::string file = name;
    if (std::atoi(CPLGetXMLValue(&node, "relativeToVRT", "0")) != 0)
      file = CPLProjectRelativeFilename(fs::weakly_canonical(vrt).parent_path().c_str(), name.c_str());
    std::error_code error;
    const fs::file_status status = fs::status(file, error);
    const bool there = fs::exists(status);
    // Refuse a missing name that GDAL may parse as XML, or as part of a file.
    if (is_elsewhere(name) || (!there && name.find_first_of("<:") != std::string::npos))
      refuse("its source " + name + " is not a file on this machine");
    if (!there) {
      result_.missing.insert(file);
      return;
    }
    // Refuse files of /proc, too: they have no size, and reading them may block as on a FIFO.
    if (!fs::is_regular_file(status) || fs::file_size(file, error) == 0)
      refuse("its source " + name + " is not a regular file with content");
    scan(file, depth + 1);
  }

  const std::string& root_;
  VrtSources result_;
  int sources_ = 0;
  std::size_t bytes_ = 0;
};

}  // namespace

VrtSources vrt_sources(const std::string& path) {
  VrtScan scan_of_root(path);
  scan_of_root.scan(path, 0);
  return std::move(scan_of_root).sources();
}

}  // namespace selenograph::dem
