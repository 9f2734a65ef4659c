// Texts that are UTF-8, and bytes that are not.
#include "engine/support/utf8.h"

#include <gtest/gtest.h>

namespace selenograph::engine {
namespace {

TEST(Utf8, DetectsInvalidSequences) {
  for (const char* good : {"", "plain", "gr\xc3\xbcn", "\xe2\x82\xac", "\xf0\x9f\x8c\x95", "\xf4\x8f\xbf\xbf"})
    EXPECT_TRUE(is_utf8(good)) << good;
  for (const char* bad : {"gr\xfcn", "\xc3", "\xc0\xaf", "\xe0\x80\xaf", "\xed\xa0\x80", "\xf0\x80\x80\xaf",
                          "\xf4\x90\x80\x80", "\xf8\x88\x80\x80\x80", "\x80", "\xe2\x82"})
    EXPECT_FALSE(is_utf8(bad)) << bad;
}

}  // namespace
}  // namespace selenograph::engine
