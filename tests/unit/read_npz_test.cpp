// Arrays of requests: what the encoders write is read back, and what no numpy.savez writes is refused by name.
#include "api/encode/read_npz.h"

#include <gtest/gtest.h>

#include <cstdint>
#include <cstring>
#include <string>
#include <vector>

#include "api/encode/encode.h"
#include "api/message/problem.h"

namespace selenograph::api {
namespace {

std::string npy_of(const std::string& header, const std::string& data) {
  std::string text = header + std::string((64 - (10 + header.size() + 1) % 64) % 64, ' ') + "\n";
  return std::string("\x93NUMPY\x01\x00", 8) + static_cast<char>(text.size()) + '\0' + text + data;
}

template <typename T>
std::string bytes_of(std::vector<T> values) {
  return {reinterpret_cast<const char*>(values.data()), values.size() * sizeof(T)};
}

std::string refusal(const std::string& bytes) {
  try {
    read_npy(bytes, "direction");
  } catch (const RequestError& e) {
    EXPECT_EQ(e.code(), "malformed_npz");
    EXPECT_EQ(e.findings().at(0).pointer, "/direction");
    return e.what();
  }
  return "";
}

TEST(ReadNpz, WhatTheEncoderWrites) {
  const std::vector<double> directions{1, 2, 3, 4, 5, 6};
  const std::vector<std::uint64_t> ids{7, 8};
  const std::vector<std::uint8_t> flags{1, 0};
  const std::string archive = encode_npz({{"direction", ElementType::float64, 2, 3, 1, directions.data(), {}},
                                          {"ids", ElementType::uint64, 2, 1, 1, ids.data(), {}, {2}},
                                          {"flags", ElementType::boolean, 2, 1, 1, flags.data(), {}, {2}}},
                                         R"({"seed": 1})");
  const NpzArrays arrays = read_npz(archive, 1000);
  ASSERT_EQ(arrays.size(), 4U);
  EXPECT_EQ(arrays.at("direction").shape, (std::vector<std::size_t>{2, 3}));
  EXPECT_EQ(arrays.at("direction").numbers, directions);
  EXPECT_EQ(arrays.at("ids").shape, std::vector<std::size_t>{2});
  EXPECT_EQ(arrays.at("ids").numbers, (std::vector<double>{7, 8}));
  EXPECT_EQ(arrays.at("flags").numbers, (std::vector<double>{1, 0}));
  EXPECT_EQ(arrays.at("meta").text, R"({"seed": 1})");
  EXPECT_THROW(read_npz(archive, 70), RequestError) << "larger than is taken";
  EXPECT_THROW(read_npz(archive.substr(0, archive.size() - 30), 1000), RequestError);
  std::string damaged = archive;
  damaged[damaged.find("NUMPY") + 130] ^= 1;
  EXPECT_THROW(read_npz(damaged, 1000), RequestError) << "a checksum differs";
}

TEST(ReadNpz, ColumnsFirst) {
  const NpzArray array = read_npy(
      npy_of("{'descr': '<i4', 'fortran_order': True, 'shape': (2, 3), }", bytes_of<std::int32_t>({1, 4, 2, 5, 3, 6})),
      "direction");
  EXPECT_EQ(array.numbers, (std::vector<double>{1, 2, 3, 4, 5, 6}));
}

TEST(ReadNpz, TextsAndScalars) {
  const NpzArray text = read_npy(npy_of("{'descr': '<U4', 'fortran_order': False, 'shape': (), }",
                                        bytes_of<std::uint32_t>({'{', 0xe9, 0x1f315, '}'})),
                                 "request");
  EXPECT_EQ(text.text, "{\xc3\xa9\xf0\x9f\x8c\x95}");
  const NpzArray number =
      read_npy(npy_of("{'descr': '<f4', 'fortran_order': False, 'shape': (), }", bytes_of<float>({2.5F})), "time_s");
  EXPECT_TRUE(number.shape.empty());
  EXPECT_EQ(number.numbers, std::vector<double>{2.5});
}

TEST(ReadNpz, RefusalsNameTheArrayAndSayWhy) {
  const std::string six = bytes_of<double>({1, 2, 3, 4, 5, 6});
  const auto header = [](const std::string& descr, const std::string& shape) {
    return "{'descr': " + descr + ", 'fortran_order': False, 'shape': " + shape + ", }";
  };
  EXPECT_EQ(refusal(npy_of(header("'<f8'", "(2, 3)"), six)), "");
  EXPECT_NE(refusal("nothing").find("is not an .npy file"), std::string::npos);
  EXPECT_NE(refusal(npy_of(header("'<f8'", "(2, 4)"), six)).find("its shape needs 64"), std::string::npos);
  EXPECT_NE(refusal(npy_of(header("'<f8'", "(2, 2)"), six)).find("its shape needs 32"), std::string::npos);
  EXPECT_NE(refusal(npy_of(header("'<f8'", "(18446744073709551615, 3)"), six)).find("shorter"), std::string::npos);
  EXPECT_NE(refusal(npy_of(header("'<f8'", "(4294967296, 4294967296)"), six)).find("shorter"), std::string::npos);
  EXPECT_EQ(refusal(npy_of(header("'<f8'", "(0, 3)"), "")), "") << "it is as long as its shape";
  EXPECT_EQ(refusal(npy_of(header("'<f8'", "(3, 0)"), "")), "");
  EXPECT_NE(refusal(npy_of(header("'<f8'", "(0, 3)"), six)).find("its shape needs 0"), std::string::npos);
  EXPECT_NE(refusal(npy_of(header("'>f8'", "(2, 3)"), six)).find("type >f8"), std::string::npos);
  EXPECT_NE(refusal(npy_of(header("'|O'", "(2, 3)"), six)).find("type |O"), std::string::npos);
  EXPECT_NE(refusal(npy_of(header("[('x', '<f8')]", "(6,)"), six)).find("fields"), std::string::npos);
  EXPECT_NE(refusal(npy_of(header("'<f8'", "(2; 3)"), six)).find("header"), std::string::npos);
  EXPECT_NE(refusal(npy_of("{'descr': '<f8'}", six)).find("header"), std::string::npos);
  EXPECT_NE(refusal(npy_of(header("'<f8'", "(2, 3)"), six).substr(0, 40)).find("header"), std::string::npos);
}

}  // namespace
}  // namespace selenograph::api
