#include "server/campaign/coco_file.h"

#include <fmt/format.h>

#include <filesystem>
#include <stdexcept>

#include "api/answers/coco.h"
#include "api/answers/metadata.h"
#include "api/encode/read_npz.h"
#include "api/message/json_text.h"
#include "api/message/version.h"
#include "server/campaign/durable_files.h"
#include "server/campaign/tar.h"

namespace selenograph::server {
namespace {

namespace fs = std::filesystem;
using OrderedJson = nlohmann::ordered_json;

// A frame's masks have pixels of uint16, so the numbers of its annotations are below this.
constexpr std::size_t kNumbersPerFrame = 65536;

// Writes the document as PATH.part: annotations as they come, images at the end; finish() gives it its name.
class CocoWriter {
 public:
  explicit CocoWriter(const std::string& path) : file_(path + ".part") {
    file_.cut(0);
    text_ = fmt::format(R"({{"info":{},"licenses":[],"categories":{},"annotations":[)",
                        api::json_text(OrderedJson{{"description", "Craters and rocks of selenograph frames"},
                                                   {"version", api::software_version()}}),
                        api::json_text(api::coco_categories()));
  }

  // Appends a frame's own document, `labels`.
  void add(const ManifestLine& line, const DoneFrame& frame, OrderedJson labels, CocoTally& tally) {
    OrderedJson image = std::move(labels.at("images").at(0));
    image["id"] = line.number;
    image["file_name"] = line.name + ".npz";
    if (frame.is_in_tar()) image["tar"] = frame.file;
    images_.push_back(std::move(image));
    for (OrderedJson& annotation : labels.at("annotations")) {
      const auto mask_id = annotation.at("id").get<std::size_t>();
      annotation["id"] = line.number * kNumbersPerFrame + mask_id;
      annotation["image_id"] = line.number;
      annotation["mask_id"] = mask_id;
      text_ += (tally.annotations++ > 0 ? ",\n" : "\n") + api::json_text(annotation);
    }
    ++tally.images;
    constexpr std::size_t kFlushBytes = std::size_t{4} << 20;
    if (text_.size() > kFlushBytes) flush();
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
    const std::string path = (fs::path(folder) / done->file).string();
    const std::uint64_t offset = done->is_in_tar() ? done->offset + kTarHeaderBytes : 0;
    const auto text = api::text_in_npz(path, offset, done->bytes, api::kCocoMember);
    if (!text) {
      ++tally.without_labels;
      continue;
    }
    OrderedJson labels = OrderedJson::parse(*text, nullptr, false);
    if (labels.is_discarded())
      throw std::runtime_error(path + ": the labels of " + line->name + " are not JSON: run batch verify --rerun");
    writer.add(*line, *done, std::move(labels), tally);
  }
  writer.finish(tally.path);
  return tally;
}

}  // namespace selenograph::server
