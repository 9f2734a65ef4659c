// Shards are a partition; a tar is listed only if it is complete; a file appears whole or not at all.
#include <gtest/gtest.h>
#include <unistd.h>

#include <filesystem>
#include <vector>

#include "dem/files/files.h"
#include "dem/files/whole_file.h"
#include "server/campaign/plan.h"
#include "server/campaign/tar.h"

namespace selenograph::server {
namespace {

namespace fs = std::filesystem;

class CampaignTest : public ::testing::Test {
 protected:
  CampaignTest() { fs::create_directories(folder_); }
  ~CampaignTest() override { fs::remove_all(folder_); }

  std::size_t files() const {
    return static_cast<std::size_t>(std::distance(fs::directory_iterator(folder_), fs::directory_iterator()));
  }

  const std::string folder_ =
      (fs::temp_directory_path() / ("selenograph-campaign-" + std::to_string(::getpid()))).string();
  const std::string path_ = folder_ + "/a.tar";
};

TEST_F(CampaignTest, ShardsAreAPartition) {
  for (const std::size_t count : {0U, 1U, 7U, 1000U})
    for (const std::size_t of : {1U, 3U, 16U}) {
      std::size_t next = 0;
      for (std::size_t i = 0; i < of; ++i) {
        const Span span = span_of(count, {i, of});
        EXPECT_EQ(span.begin, next);
        EXPECT_LE(span.size(), count / of + 1);
        EXPECT_GE(span.size(), count / of);
        next = span.end;
      }
      EXPECT_EQ(next, count);
    }
}

TEST_F(CampaignTest, ATarIsListedWithItsContents) {
  const std::string tar = tar_member("one", "first") + tar_member("two", std::string(512, '2')) + tar_end();
  dem::write_whole_file(path_, tar);
  const std::vector<TarMember> members = list_tar(path_);
  ASSERT_EQ(members.size(), 2U);
  EXPECT_EQ(members[1].name, "two");
  EXPECT_EQ(tar.substr(members[0].offset, members[0].bytes), "first");
  EXPECT_EQ(tar.substr(members[1].offset, members[1].bytes), std::string(512, '2'));
  for (const std::size_t cut : {1U, 512U, 1024U, 1025U, 1500U, 2048U}) {
    dem::write_whole_file(path_, tar.substr(0, tar.size() - cut));
    EXPECT_THROW(list_tar(path_), std::runtime_error) << cut;
  }
}

TEST_F(CampaignTest, AFileAppearsWholeOrNotAtAll) {
  {
    dem::WholeFile abandoned(path_);
    abandoned.write("half");
    EXPECT_EQ(files(), 1U) << "the temporary file";
    EXPECT_FALSE(fs::exists(path_));
  }
  EXPECT_EQ(files(), 0U);
  dem::WholeFile first(path_), second(path_);
  first.write("first");
  second.write("sec");
  second.write("ond");
  second.finish();
  EXPECT_EQ(dem::read_whole(path_), "second");
  first.finish();
  EXPECT_EQ(dem::read_whole(path_), "first");
  EXPECT_EQ(files(), 1U);
}

}  // namespace
}  // namespace selenograph::server
