#include "server/campaign/store.h"

#include <fmt/format.h>
#include <unistd.h>

#include <filesystem>
#include <stdexcept>

#include "server/campaign/tar.h"

namespace selenograph::server {
namespace {

namespace fs = std::filesystem;

std::optional<std::uint64_t> size_of(const std::string& path) {
  std::error_code error;
  const std::uintmax_t size = fs::file_size(path, error);
  return error ? std::nullopt : std::optional<std::uint64_t>(size);
}

DoneFrame done_frame(const ManifestLine& line, const RenderedFrame& frame, const std::string& file) {
  return {.name = line.name,
          .line = line.number,
          .request_sha256 = line.request_sha256,
          .content_hash = frame.content_hash,
          .sha256 = sha256(frame.bytes),
          .bytes = frame.bytes.size(),
          .ms = frame.ms,
          .file = file,
          .offset = 0,
          .time = {},
          .made_by = {}};
}

}  // namespace

FrameFolder::FrameFolder(std::string folder, const std::string& suffix, const Shard& shard, const Record& record,
                         Journal& journal)
    : folder_(std::move(folder)),
      suffix_("." + suffix),
      temporary_suffix_(fmt::format(".part-{:05}-of-{:05}", shard.index, shard.of)),
      record_(record),
      journal_(journal) {
  for (const fs::directory_entry& entry : fs::directory_iterator(folder_))
    if (entry.path().string().ends_with(temporary_suffix_)) fs::remove(entry.path());
}

std::string FrameFolder::path_of(const ManifestLine& line) const { return in_folder(folder_, line.name + suffix_); }

bool FrameFolder::has(const ManifestLine& line) const {
  const DoneFrame* done = record_.frame(line.name);
  return done && !done->is_in_tar() && done->request_sha256 == line.request_sha256 &&
         size_of(path_of(line)) == done->bytes;
}

bool FrameFolder::is_taken(const ManifestLine& line) const {
  const DoneFrame* done = record_.frame(line.name);
  if (done && done->request_sha256 == line.request_sha256) return false;  // the campaign's own, perhaps damaged
  return fs::exists(path_of(line));
}

void FrameFolder::put(const ManifestLine& line, const RenderedFrame& frame) {
  const std::string path = path_of(line), temporary = path + temporary_suffix_;
  write_to_disk(temporary, frame.bytes);
  try {
    // Remove an earlier frame first: after a crash behind the journal's line, the name must not refer to its bytes.
    if (fs::exists(path)) remove_on_disk(path);
    journal_.add(done_frame(line, frame, line.name + suffix_));
    rename_on_disk(temporary, path);
  } catch (...) {
    ::unlink(temporary.c_str());
    throw;
  }
}

bool TarWriter::has(const std::string& folder, const TarPlan& plan, const Record& record) {
  const std::string path = in_folder(folder, plan.name);
  const DoneTar* done = record.tar(plan.name);
  const bool is_same_plan = done && done->plan == plan.sha256();
  // A tar none of whose lines has become a frame leaves no file.
  if (is_same_plan && done->frames == 0) return true;
  const auto size = size_of(path);
  if (!size) return false;
  if (!is_same_plan)
    throw std::runtime_error(path +
                             ": was not made from this manifest by this software on this terrain: give them "
                             "a folder of their own");
  return *size == done->bytes;
}

TarWriter::TarWriter(const std::string& folder, const std::string& suffix, const TarPlan& plan, Journal& journal)
    : path_(in_folder(folder, plan.name)),
      suffix_("." + suffix),
      plan_(plan),
      journal_(journal),
      file_(path_ + ".part") {
  file_.cut(0);
}

void TarWriter::put(const ManifestLine& line, const RenderedFrame& frame) {
  DoneFrame done = done_frame(line, frame, plan_.name);
  done.offset = file_.size();
  const std::string member = tar_member(line.name + suffix_, frame.bytes);
  file_.append(member);
  digest_.add(member);
  journal_.add(done);
  ++frames_;
}

void TarWriter::finish() {
  if (frames_ == 0) {
    remove_on_disk(file_.path());
    journal_.add(DoneTar{plan_.name, plan_.sha256(), "", 0, 0, {}, {}});
    return;
  }
  const std::string end = tar_end();
  file_.append(end);
  digest_.add(end);
  if (fs::exists(path_)) remove_on_disk(path_);
  journal_.add(DoneTar{plan_.name, plan_.sha256(), digest_.hex(), file_.size(), frames_, {}, {}});
  rename_on_disk(file_.path(), path_);
}

}  // namespace selenograph::server
