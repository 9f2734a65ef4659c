// Vectors, matrices and rotations: Eigen's are another implementation of each.
#include "dem/grid/vec.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <cmath>
#include <random>

#include "dem/grid/rotation.h"
#include "tests/support/vec_text.h"

namespace selenograph {
namespace {

constexpr double kRounding = 1e-14;

Eigen::Vector3d eigen(const Vec3& v) { return {v.x(), v.y(), v.z()}; }
Eigen::Matrix3d eigen(const Mat3& m) {
  Eigen::Matrix3d out;
  out << eigen(m.col(0)), eigen(m.col(1)), eigen(m.col(2));
  return out;
}
Eigen::Matrix2d eigen(const Mat2& m) { return Eigen::Matrix2d{{m(0, 0), m(0, 1)}, {m(1, 0), m(1, 1)}}; }
Eigen::Quaterniond eigen(const Quat& q) { return {q.w, q.x, q.y, q.z}; }
Eigen::AngleAxisd eigen(const AngleAxis& turn) { return {turn.angle_rad, eigen(turn.axis)}; }

class Vectors : public testing::Test {
 protected:
  double number() { return any_(random_); }
  Vec3 vector() { return {number(), number(), number()}; }
  template <typename Ours, typename Eigens>
  static void expect_same(const Ours& ours, const Eigens& theirs) {
    EXPECT_LE((eigen(ours) - theirs).norm(), kRounding * (1 + theirs.norm()));
  }

 private:
  std::mt19937_64 random_{7};
  std::normal_distribution<double> any_;
};

TEST_F(Vectors, MatricesMultiplyAndInvert) {
  for (int i = 0; i < 2000; ++i) {
    const Mat3 m(vector(), vector(), vector()), n(vector(), vector(), vector());
    const Vec3 v = vector();
    expect_same(m * v, eigen(m) * eigen(v));
    expect_same(m.transpose_times(v), eigen(m).transpose() * eigen(v));
    expect_same(m * n.transpose(), eigen(m) * eigen(n).transpose());
    EXPECT_LE((m * m.inverse() - Mat3::identity()).norm(), kRounding * m.norm() * m.inverse().norm());
    EXPECT_NEAR(m.determinant(), eigen(m).determinant(), kRounding * std::pow(m.norm(), 3));
    const Mat2 small(m.col(0).xy(), m.col(1).xy());
    expect_same(small * small, eigen(small) * eigen(small));
    EXPECT_LE((small * small.inverse() - Mat2::identity()).norm(), kRounding * small.norm() * small.inverse().norm());
  }
}

TEST_F(Vectors, RotationsInEveryForm) {
  for (int i = 0; i < 2000; ++i) {
    const Quat p = Quat(number(), number(), number(), number()).normalized();
    const AngleAxis turn(number(), vector().normalized());
    const Vec3 v = vector(), w = vector();
    expect_same(p * v, eigen(p) * eigen(v));
    expect_same(turn * v, eigen(turn) * eigen(v));
    expect_same(p.matrix(), eigen(p).toRotationMatrix());
    expect_same((p * Quat(turn)).matrix(), (eigen(p) * eigen(turn)).toRotationMatrix());
    expect_same(Quat(p.matrix()).matrix(), eigen(p).toRotationMatrix());
    expect_same(AngleAxis(p).matrix(), eigen(p).toRotationMatrix());
    EXPECT_NEAR(p.angle_to(Quat(turn)), eigen(p).angularDistance(Eigen::Quaterniond(eigen(turn))), 1e-7);
    expect_same(shortest_turn(v, w).matrix(),
                Eigen::Quaterniond::FromTwoVectors(eigen(v), eigen(w)).toRotationMatrix());
  }
}

TEST(ShortestTurn, TurnsOppositeDirectionsByHalfACircle) {
  for (const Vec3& from : {Vec3(1, 0, 0), Vec3(0, -2, 0), Vec3(0, 0, 1), Vec3(1, 2, 3)})
    for (const double off : {0.0, 1e-15, 1e-13, 1e-7, 1e-5}) {
      const Vec3 to = -from + off * from.unit_orthogonal();
      const Quat turn = shortest_turn(from, to);
      constexpr double kTolerance = 1e-4;  // 1 + cosine cancels: worst just before directions count as opposite
      EXPECT_NEAR(turn.norm(), 1, kTolerance);
      EXPECT_LT((turn * from.normalized() - to.normalized()).norm(), kTolerance) << from << ' ' << off;
    }
}

}  // namespace
}  // namespace selenograph
