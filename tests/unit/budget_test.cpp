// Time budgets: what is predicted, what is learnt, what is chosen.
#include "engine/cache/budget.h"

#include <gtest/gtest.h>

#include <chrono>
#include <optional>

#include "dem/base/error.h"
#include "engine/renderer.h"
#include "tests/support/float_tiles.h"
#include "tests/support/shared_data.h"
#include "tests/support/views.h"

namespace selenograph::engine {
namespace {

FrameRequest small_frame() {
  FrameRequest request;
  request.camera = {64, 48, 60, 60, 31.5, 23.5, {}};
  request.products = kRadiance;
  return request;
}

TEST(FrameWork, CountsRays) {
  FrameRequest request = small_frame();
  const double pixels = 64 * 48;
  const auto rays = [&](const Accuracy& accuracy, Visibility by = Visibility::raytrace) {
    return work_of(request, accuracy, by, 10, true).rays / pixels;
  };
  EXPECT_EQ(rays({}), 2) << "one to the ground, one to the Sun";
  EXPECT_EQ(rays({.samples_per_pixel = 4}), 8);
  EXPECT_NEAR(rays({.samples_per_pixel = 4}, Visibility::zbuffer), 4, 1) << "drawn at once";
  EXPECT_EQ(rays({.samples_per_pixel = 9}, Visibility::zbuffer), 18) << "one after the other";
  request.products = kRange;
  EXPECT_EQ(rays({.samples_per_pixel = 4}), 1) << "geometry is of pixel centres";
  request.products = kRange | kRadiance;
  EXPECT_EQ(rays({.samples_per_pixel = 4}), 10);
  request.sun.angular_radius_deg = 0.27;
  EXPECT_GT(rays({.samples_per_pixel = 4}), 50);
  EXPECT_LT(rays({.samples_per_pixel = 4}, Visibility::zbuffer), 20);
}

TEST(SpeedGauge, LearnsTheTimeOfFrames) {
  SpeedGauge gauge(2);
  const FrameWork warm{1e6, 1e6, false}, cold{1e6, 1e6, true};
  EXPECT_GT(gauge.predicted_ms(cold), gauge.predicted_ms(warm));
  for (int i = 0; i < 200; ++i) gauge.learn(cold, {.build_ms = 300, .visibility_ms = 40});
  EXPECT_NEAR(gauge.predicted_ms(warm), 40, 0.01);
  EXPECT_NEAR(gauge.predicted_ms(cold), 340, 0.01);
  EXPECT_NEAR(gauge.predicted_ms({2e6, 1e6, false}), 79, 1) << "nearly in proportion to the rays";
  gauge.learn(warm, {.visibility_ms = 1e9});
  EXPECT_LT(gauge.predicted_ms(warm), 60) << "one frame that waited isn't the machine's speed";
}

TEST(SpeedGauge, SmallFramesSayLittleOfLargeOnes) {
  SpeedGauge gauge(2);
  const FrameWork small{3000, 1e5, false}, large{1e9, 1e6, false};
  const double before = gauge.predicted_ms(large);
  for (int i = 0; i < 1000; ++i) gauge.learn(small, {.visibility_ms = 12});
  EXPECT_NEAR(gauge.predicted_ms(small), 12, 0.01);
  EXPECT_LT(gauge.predicted_ms(large), 2 * before);
}

TEST(SpeedGauge, RefusesWhatIsOutOfReach) {
  using namespace std::chrono_literals;
  SpeedGauge gauge(1);
  const FrameWork work{1e9, 1e6, false};
  const double ms = gauge.predicted_ms(work);
  ASSERT_GT(ms, 20e3);
  const auto token = [](double left_ms) {
    return StopToken(StopToken::Clock::now() + std::chrono::microseconds(static_cast<std::int64_t>(left_ms * 1e3)));
  };
  EXPECT_NO_THROW(gauge.refuse_hopeless(work, 1, "", {})) << "no deadline";
  EXPECT_NO_THROW(gauge.refuse_hopeless(work, 1, "", token(ms / 3)));
  EXPECT_EQ(gauge.predicted_ms(work), ms);
  try {
    gauge.refuse_hopeless(work, 2, "fewer pixels take less", token(ms / 3));
    ADD_FAILURE() << "not refused";
  } catch (const TooMuchWork& e) {
    EXPECT_NE(std::string(e.what()).find(" s; fewer pixels take less"), std::string::npos) << e.what();
  }
  EXPECT_LT(gauge.predicted_ms(work), ms) << "and is believed less";
  EXPECT_NO_THROW(gauge.refuse_hopeless({1e6, 1e6, false}, 1, "", token(1))) << "what takes moments is tried";
}

TEST(ExpectedError, FinerTerrainWantsMoreSamples) {
  for (const double error_px : kBudgetErrors_px)
    for (std::size_t i = 1; i < kBudgetSamples.size(); ++i)
      EXPECT_LT(expected_error({.max_error_px = error_px, .samples_per_pixel = kBudgetSamples[i]}),
                expected_error({.max_error_px = error_px, .samples_per_pixel = kBudgetSamples[i - 1]}));
  for (std::size_t i = 1; i < kBudgetErrors_px.size(); ++i)
    EXPECT_LT(expected_error({.max_error_px = kBudgetErrors_px[i], .samples_per_pixel = 16}),
              expected_error({.max_error_px = kBudgetErrors_px[i - 1], .samples_per_pixel = 16}));
  // The default is the best of one sample per pixel: that is why it is the default.
  for (const double error_px : kBudgetErrors_px)
    EXPECT_GE(expected_error({.max_error_px = error_px}), expected_error(Accuracy{}));
}

class Budget : public ::testing::Test {
 protected:
  void SetUp() override {
    test::write_float_tile(folder_.path(), "t", {12, 22, 128, 4 * 128 + 1, 4 * 128 + 1}, [](double lat, double lon) {
      return 800 * std::sin(lat * 40) * std::cos(lon * 37) + 60 * std::sin(lat * 310 + lon * 290);
    });
    renderer_ =
        std::make_unique<Renderer>(test::open_terrain(folder_.path()), RendererOptions{2, std::size_t{256} << 20});
    request_ = small_frame();
    request_.pose = test::looking(to_cartesian({10, 24, 60000}), -to_cartesian({10, 24, 1}), Vec3::unit_z());
    request_.sun.direction = request_.pose.position_m.normalized();
    for (int i = 0; i < 30; ++i) renderer_->render(request_);  // how fast is it?
  }
  test::TemporaryFolder folder_;
  std::unique_ptr<Renderer> renderer_;
  FrameRequest request_;
};

TEST_F(Budget, LargeBudgetChoosesTheFinest) {
  const BudgetChoice choice = renderer_->choose(request_, 3.6e6, 256);
  EXPECT_TRUE(choice.fits);
  EXPECT_EQ(choice.accuracy.max_error_px, kBudgetErrors_px.back());
  EXPECT_EQ(choice.accuracy.samples_per_pixel, kBudgetSamples.back());
  EXPECT_EQ(renderer_->choose(request_, 3.6e6, 4).accuracy.samples_per_pixel, 4) << "no more than the service allows";
}

TEST_F(Budget, TinyBudgetChoosesTheCoarsest) {
  const BudgetChoice choice = renderer_->choose(request_, 1e-6, 256);
  EXPECT_FALSE(choice.fits);
  EXPECT_GT(choice.predicted_ms, 1e-6);
  EXPECT_EQ(choice.accuracy.max_error_px, kBudgetErrors_px.front());
  EXPECT_EQ(choice.accuracy.samples_per_pixel, 1);
}

// Of settings whose times are predictions; Renderer::choose adds the time that it measures for choosing.
TEST(BudgetChoice, MoreTimeNeverChoosesLess) {
  const SpeedGauge gauge(2);
  double error = 1e9;
  int improvements = 0;
  for (double ms = 0.05; ms < 1e6; ms *= 4) {
    std::optional<BudgetChoice> best;
    for (const double error_px : kBudgetErrors_px)
      for (const int samples : kBudgetSamples) {
        const Accuracy accuracy{.max_error_px = error_px, .samples_per_pixel = samples};
        const double predicted_ms = gauge.predicted_ms(
            work_of(small_frame(), accuracy, Visibility::raytrace, 1e5 / (error_px * error_px), true));
        prefer(best, {accuracy, predicted_ms, predicted_ms <= ms});
      }
    EXPECT_TRUE(!best->fits || best->predicted_ms <= ms) << best->predicted_ms;
    EXPECT_LE(expected_error(best->accuracy), error) << ms;
    improvements += expected_error(best->accuracy) < error;
    error = expected_error(best->accuracy);
  }
  EXPECT_GT(improvements, 4);
}

}  // namespace
}  // namespace selenograph::engine
