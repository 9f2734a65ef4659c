// What a mesh's reader answers, and what is made of an answer that is none.
#include "engine/visibility/meshes/mesh_answer.h"

#include <gtest/gtest.h>

#include <cmath>
#include <stdexcept>

#include "engine/support/utf8.h"

namespace selenograph::engine {
namespace {

ObjectShape triangle() {
  ObjectShape shape;
  shape.corners = {{{0, 0, 0}, {0, 0, 0}}, {{1, 0, 0}, {0, 0, 1}}, {{0, 1, 0}, {0, 0.6F, 0.8F}}};
  shape.triangles = {{{0, 1, 2}, 1}};
  shape.parts = {"", "gr\xc3\xbcn"};
  shape.textured = true;
  return shape;
}

std::string fault_in(const std::string& answer) {
  try {
    shape_of_answer(answer);
  } catch (const std::runtime_error& e) {
    return e.what();
  }
  return "";
}

TEST(MeshAnswer, RoundTripsTheShape) {
  const ObjectShape shape = shape_of_answer(shape_answer(triangle()));
  ASSERT_EQ(shape.corners.size(), 3U);
  EXPECT_EQ(shape.corners[2].normal, triangle().corners[2].normal);
  ASSERT_EQ(shape.triangles.size(), 1U);
  EXPECT_EQ(shape.triangles[0].corner, triangle().triangles[0].corner);
  EXPECT_EQ(shape.parts, triangle().parts);
  EXPECT_TRUE(shape.textured);
}

TEST(MeshAnswer, HoldsTheError) {
  EXPECT_EQ(fault_in(refusal_answer("has no triangle")), "has no triangle");
  EXPECT_EQ(fault_in(refusal_answer(std::string(5000, 'x'))), std::string(kMaxRefusalBytes, 'x'));
}

TEST(MeshAnswer, RejectsTruncatedAnswers) {
  const std::string whole = shape_answer(triangle());
  for (std::size_t n = 0; n < whole.size(); ++n) EXPECT_NE(fault_in(whole.substr(0, n)), "") << n;
  EXPECT_NE(fault_in(whole + "x"), "");
}

TEST(MeshAnswer, RejectsInvalidAnswers) {
  const auto with = [](void (*change)(ObjectShape&)) {
    ObjectShape shape = triangle();
    change(shape);
    return fault_in(shape_answer(shape));
  };
  EXPECT_NE(with([](ObjectShape& s) { s.corners[1].place.y() = std::nanf(""); }), "");
  EXPECT_NE(with([](ObjectShape& s) { s.corners[1].place.y() = INFINITY; }), "");
  EXPECT_NE(with([](ObjectShape& s) { s.corners[1].normal.x() = 7; }), "");
  EXPECT_NE(with([](ObjectShape& s) { s.corners[1].normal.x() = std::nanf(""); }), "");
  EXPECT_NE(with([](ObjectShape& s) { s.triangles[0].corner[2] = 3; }), "");
  EXPECT_NE(with([](ObjectShape& s) { s.triangles[0].part = 2; }), "");
  EXPECT_NE(with([](ObjectShape& s) { s.triangles.clear(); }), "");
  EXPECT_NE(with([](ObjectShape& s) { s.parts[1] = "gr\xfcn"; }), "");
  // Counts of what isn't there: refused before anything is allocated.
  for (std::size_t count = 4; count < 16; count += 4)
    EXPECT_NE(fault_in(shape_answer(triangle()).replace(count, 4, "\xff\xff\xff\xff")), "");
}

TEST(Utf8, DetectsInvalidSequences) {
  for (const char* good : {"", "plain", "gr\xc3\xbcn", "\xe2\x82\xac", "\xf0\x9f\x8c\x95", "\xf4\x8f\xbf\xbf"})
    EXPECT_TRUE(is_utf8(good)) << good;
  for (const char* bad : {"gr\xfcn", "\xc3", "\xc0\xaf", "\xe0\x80\xaf", "\xed\xa0\x80", "\xf0\x80\x80\xaf",
                          "\xf4\x90\x80\x80", "\xf8\x88\x80\x80\x80", "\x80", "\xe2\x82"})
    EXPECT_FALSE(is_utf8(bad)) << bad;
}

}  // namespace
}  // namespace selenograph::engine
