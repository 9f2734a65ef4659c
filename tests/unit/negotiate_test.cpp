#include "api/encode/negotiate.h"

#include <gtest/gtest.h>

#include "api/message/problem.h"

namespace selenograph::api {
namespace {

using engine::kImage, engine::kRadiance, engine::kRange;

std::string chosen(const std::string& accept, engine::ProductSet products) {
  try {
    return std::string(negotiate(accept, products).media_type);
  } catch (const RequestError& e) {
    return e.code() + (e.findings().empty() ? "" : " " + e.findings()[0].pointer);
  }
}

TEST(Negotiate, WithoutPreferenceTheProductsDecide) {
  for (const char* accept : {"", "*/*", "*/*;q=0.5", " ", "text/html, */*;q=0.1"}) {
    EXPECT_EQ(chosen(accept, kRadiance), "application/x-npy") << accept;
    EXPECT_EQ(chosen(accept, kRadiance | kRange), "application/x-npz") << accept;
    EXPECT_EQ(chosen(accept, kImage), "image/png") << accept;
    EXPECT_EQ(chosen(accept, kImage | kRange), "application/x-npz") << accept;
  }
}

TEST(Negotiate, HighestWeightWins) {
  EXPECT_EQ(chosen("image/tiff", kRadiance), "image/tiff");
  EXPECT_EQ(chosen("application/x-npy;q=0.3, image/tiff;q=0.7", kRadiance), "image/tiff");
  EXPECT_EQ(chosen("Application/X-NPY ; Q=0.9 , image/tiff;q=0.7", kRadiance), "application/x-npy");
  EXPECT_EQ(chosen("image/*", kImage), "image/png");
  EXPECT_EQ(chosen("image/*", kRadiance), "image/tiff");
  EXPECT_EQ(chosen("image/*", kRadiance | kRange), "image/x-exr");
}

TEST(Negotiate, TheMoreSpecificRangeGoverns) {
  EXPECT_EQ(chosen("*/*, application/x-npy;q=0", kRadiance), "application/x-npz");
  EXPECT_EQ(chosen("application/*;q=0.2, application/octet-stream;q=0.9, */*;q=0.5", kRadiance),
            "application/octet-stream");
  EXPECT_EQ(chosen("image/png;q=0, image/*", kImage), "image/tiff");
}

TEST(Negotiate, SkipsFormatsThatCannotHoldTheProducts) {
  EXPECT_EQ(chosen("application/x-npy, application/x-npz;q=0.1", kRadiance | kRange), "application/x-npz");
  EXPECT_EQ(chosen("image/png, */*;q=0.1", kRadiance), "application/x-npy");
}

TEST(Negotiate, AcceptedButUnableIsInvalidAndPointsAtProducts) {
  for (const char* accept : {"application/x-npy", "image/tiff", "application/octet-stream", "image/png"}) {
    EXPECT_EQ(chosen(accept, kRadiance | kRange), "invalid_request /products") << accept;
  }
  EXPECT_EQ(chosen("image/png", kRadiance), "invalid_request /products");
  EXPECT_EQ(chosen("image/png", kImage | kRange), "invalid_request /products");
}

TEST(Negotiate, NothingAcceptedIsNotAcceptable) {
  for (const char* accept :
       {"text/html", "application/json, text/*", "image/jpeg", "*/*;q=0", "nonsense", "image/png;q=x"}) {
    EXPECT_EQ(chosen(accept, kRadiance), "not_acceptable") << accept;
  }
  try {
    negotiate("text/html", kRadiance);
    FAIL();
  } catch (const RequestError& e) {
    for (const Representation& r : representations()) {
      EXPECT_NE(std::string(e.what()).find(r.media_type), std::string::npos) << r.media_type;
    }
  }
}

TEST(Negotiate, AlternativesThatCannotHoldTheAnswerArePassedOver) {
  const Alternative all[] = {{"image/tiff", ""}, {"application/x-npz", ""}, {"image/png", ""}};
  const auto chosen_of = [&](const std::string& accept) {
    return choose_media_type(accept, all, [](std::string_view type) { return type != "image/png"; });
  };
  EXPECT_EQ(choose_media_type("image/png, application/x-npz;q=0.9", all), "image/png");
  EXPECT_EQ(chosen_of("image/png, application/x-npz;q=0.9"), "application/x-npz");
  EXPECT_EQ(chosen_of("image/png, */*;q=0.5"), "image/tiff");
  EXPECT_EQ(chosen_of("image/png"), "image/png");  // for the caller to refuse: it knows why
  EXPECT_THROW(chosen_of("text/html"), RequestError);
  EXPECT_THROW(chosen_of("image/png;q=0"), RequestError);
}

TEST(Negotiate, Accepts) {
  EXPECT_TRUE(accepts("", "application/json"));
  EXPECT_TRUE(accepts("text/html, application/*;q=0.1", "application/json"));
  EXPECT_FALSE(accepts("text/html", "application/json"));
  EXPECT_FALSE(accepts("*/*, application/json;q=0", "application/json"));
}

}  // namespace
}  // namespace selenograph::api
