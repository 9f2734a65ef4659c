#include "server/campaign/coco_file.h"

#include <fmt/format.h>

#include <filesystem>
#include <optional>
#include <stdexcept>

#include "api/answers/coco.h"
#include "api/answers/metadata.h"
#include "api/encode/read_npz.h"
#include "api/message/json_text.h"
#include "server/campaign/durable_files.h"
#include "server/campaign/tar.h"

namespace selenograph::server {
namespace {

namespace fs = std::filesystem;
using OrderedJson = nlohmann::ordered_json;

// Masks are of uint16: numbers of annotations in a frame are below.
constexpr std::size_t kNumbersPerFrame = 65536;

// Where a frame's .npz is.
struct Place {
  std::string file;  // of the folder
  std::uint64_t offset;
};

Place place_of(const DoneFrame& frame) {
  if (frame.tar.empty()) return {frame.name + ".npz", 0};
  return {frame.tar, frame.offset + kTarHeaderBytes};
}

class CocoWriter {
 public:
  explicit CocoWriter(const std::string& path) : file_(path + ".part") {
    file_.cut(0);
    text_ = fmt::format(R"({{"info":{},"licenses":[],"categories":{},"annotations":[)",
                        api::json_text(OrderedJson{{"description", "Craters and rocks of selenograph frames"},
                                                   {"version", api::software_version()}}),
                        api::json_text(api::coco_categories()));
  }

  // `labels`: a frame's own document.
  void add(const ManifestLine& line, const Place& place, bool in_tar, OrderedJson labels, CocoTally& tally) {
    OrderedJson image = std::move(labels.at("images").at(0));
    image["id"] = line.number;
    image["file_name"] = line.name + ".npz";
    if (in_tar) image["tar"] = place.file;
    images_.push_back(std::move(image));
    for (OrderedJson& annotation : labels.at("annotations")) {
      const auto mask_id = annotation.at("id").get<std::size_t>();
      annotation["id"] = line.number * kNumbersPerFrame + mask_id;
      annotation["image_id"] = line.number;
      annotation["mask_id"] = mask_id;
      text_ += (tally.annotations++ > 0 ? ",\n" : "\n") + api::json_text(annotation);
    }
    ++tally.images;
    constexpr std::size_t kPiece = std::size_t{4} << 20;
    if (text_.size() > kPiece) flush();
  }

  void finish(const std::string& path) {
    text_ += "],\n\"images\":" + api::json_text(images_) + "}\n";
    flush();
    rename_on_disk(file_.path(), path);
  }

 private:
  void flush() {
    file_.append(text_);
    text_.clear();
  }

  GrowingFile file_;
  std::string text_;  // not yet written
  OrderedJson images_ = OrderedJson::array();
};

}  // namespace

CocoTally write_coco(const std::vector<const ManifestLine*>& lines, const Record& record, const Shard& shard,
                     const std::string& folder, const std::atomic<bool>& stop) {
  CocoTally tally;
  tally.path = (fs::path(folder) / fmt::format("coco-{:05}-of-{:05}.json", shard.index, shard.of)).string();
  CocoWriter writer(tally.path);
  for (const ManifestLine* line : lines) {
    if (stop) throw std::runtime_error(tally.path + ": interrupted");
    const DoneFrame* done = line->problem ? nullptr : record.frame(line->name);
    if (!done || done->request_sha256 != line->request_sha256) continue;
    const Place place = place_of(*done);
    const std::string path = (fs::path(folder) / place.file).string();
    const auto text = api::text_in_npz(path, place.offset, done->bytes, api::kCocoMember);
    if (!text) {
      ++tally.without;
      continue;
    }
    OrderedJson labels = OrderedJson::parse(*text, nullptr, false);
    if (labels.is_discarded()) throw std::runtime_error(path + ": the labels of " + line->name + " are damaged");
    writer.add(*line, place, !done->tar.empty(), std::move(labels), tally);
  }
  writer.finish(tally.path);
  return tally;
}

}  // namespace selenograph::server
