// Vectors, matrices and rotations have the bits of Eigen's, in which recorded answers were computed: dem/grid/vec.h.
#include "dem/grid/vec.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <Eigen/LU>
#include <cmath>
#include <random>

#include "dem/grid/rotation.h"

namespace selenograph {
namespace {

constexpr int kSamples = 2000;

template <typename T>
using EigenVector = Eigen::Matrix<T, 3, 1>;
template <typename T>
using EigenMatrix = Eigen::Matrix<T, 3, 3>;

template <typename T>
EigenVector<T> eigen(const Vector3<T>& v) {
  return {v.x(), v.y(), v.z()};
}
template <typename T>
EigenMatrix<T> eigen(const Matrix3<T>& m) {
  EigenMatrix<T> out;
  for (int c = 0; c < 3; ++c) out.col(c) = eigen(m.col(c));
  return out;
}
Eigen::Matrix2d eigen(const Mat2& m) {
  Eigen::Matrix2d out;
  out << m(0, 0), m(0, 1), m(1, 0), m(1, 1);
  return out;
}
Eigen::Quaterniond eigen(const Quat& q) { return {q.w, q.x, q.y, q.z}; }
Eigen::AngleAxisd eigen(const AngleAxis& turn) { return {turn.angle_rad, eigen(turn.axis)}; }

template <typename T>
class Draws {
 public:
  T number() { return static_cast<T>(any_(random_)); }
  Vector3<T> vector() { return {number(), number(), number()}; }
  Matrix3<T> matrix() { return {vector(), vector(), vector()}; }
  Quat quaternion() { return Quat(number(), number(), number(), number()); }

 private:
  std::mt19937_64 random_{7};
  std::normal_distribution<double> any_;
};

template <typename T>
class Vectors : public testing::Test {};
using Scalars = testing::Types<double, float>;
TYPED_TEST_SUITE(Vectors, Scalars);

TYPED_TEST(Vectors, AreEigensToTheBit) {
  using T = TypeParam;
  Draws<T> draws;
  for (int i = 0; i < kSamples; ++i) {
    const Vector3<T> a = draws.vector(), b = draws.vector();
    const EigenVector<T> ea = eigen(a), eb = eigen(b);
    const T s = draws.number();
    EXPECT_EQ(a.dot(b), ea.dot(eb));
    EXPECT_EQ(a.norm(), ea.norm());
    EXPECT_EQ(a.squared_norm(), ea.squaredNorm());
    EXPECT_EQ((a - b).squared_norm(), (ea - eb).squaredNorm());
    EXPECT_EQ(eigen(a.normalized()), ea.normalized());
    EXPECT_EQ(eigen(a.cross(b)), ea.cross(eb));
    EXPECT_EQ(eigen(a + s * b - a / s), ea + s * eb - ea / s);
    EXPECT_EQ(a.max_abs(), ea.cwiseAbs().maxCoeff());
    EXPECT_EQ(eigen(a.template cast<float>()), ea.template cast<float>().eval());
  }
}

TYPED_TEST(Vectors, AreMultipliedByMatricesAsByEigens) {
  using T = TypeParam;
  Draws<T> draws;
  for (int i = 0; i < kSamples; ++i) {
    const Matrix3<T> m = draws.matrix(), n = draws.matrix();
    const Vector3<T> v = draws.vector();
    const EigenMatrix<T> em = eigen(m), en = eigen(n);
    const EigenVector<T> ev = eigen(v);
    EXPECT_EQ(eigen(m * v), (em * ev).eval());
    EXPECT_EQ(eigen(m.transpose_times(v)), (em.transpose() * ev).eval());
    EXPECT_EQ(eigen(m * n), (em * en).eval());
    EXPECT_EQ(eigen(m * n.transpose()), (em * en.transpose()).eval());
    EXPECT_EQ(eigen(m.transpose_times(n)), (em.transpose() * en).eval());
    EXPECT_EQ(eigen(m + n - m / T(3)), em + en - em / T(3));
  }
}

TEST(Matrices, AreInvertedAsEigens) {
  Draws<double> draws;
  for (int i = 0; i < kSamples; ++i) {
    const Mat3 m = draws.matrix();
    EXPECT_EQ(eigen(m.inverse()), eigen(m).inverse().eval());
    EXPECT_EQ(m.determinant(), eigen(m).determinant());
    const Mat2 small{m.col(0).xy(), m.col(1).xy()};
    EXPECT_EQ(eigen(small.inverse()), eigen(small).inverse().eval());
    EXPECT_EQ(small.determinant(), eigen(small).determinant());
    EXPECT_EQ(small.norm(), eigen(small).norm());
    EXPECT_EQ(eigen(small * small), (eigen(small) * eigen(small)).eval());
  }
}

TEST(UnitOrthogonal, IsEigens) {
  Draws<double> draws;
  for (int i = 0; i < kSamples; ++i) {
    Vec3 v = draws.vector();
    if (i % 2) v = {v.x() * 1e-14, v.y() * 1e-14, v.z()};
    EXPECT_EQ(eigen(v.unit_orthogonal()), eigen(v).unitOrthogonal());
  }
}

TEST(Rotations, AreEigensToTheBit) {
  Draws<double> draws;
  for (int i = 0; i < kSamples; ++i) {
    const Quat p = draws.quaternion().normalized(), q = draws.quaternion();
    const Vec3 v = draws.vector();
    const AngleAxis turn(draws.number(), v.normalized());
    EXPECT_EQ(q.norm(), eigen(q).norm());
    EXPECT_EQ(eigen(q.normalized()).coeffs(), eigen(q).normalized().coeffs());
    EXPECT_EQ(eigen(p * q).coeffs(), (eigen(p) * eigen(q)).coeffs());
    EXPECT_EQ(eigen(turn * p).coeffs(), (eigen(turn) * eigen(p)).coeffs());
    EXPECT_EQ(eigen(p * turn).coeffs(), (eigen(p) * eigen(turn)).coeffs());
    EXPECT_EQ(eigen(p * v), eigen(p) * eigen(v));
    EXPECT_EQ(eigen(turn * v), eigen(turn) * eigen(v));
    EXPECT_EQ(eigen(p.matrix()), eigen(p).toRotationMatrix());
    EXPECT_EQ(eigen(turn.matrix()), eigen(turn).toRotationMatrix());
    EXPECT_EQ(eigen(Quat(p.matrix())).coeffs(), Eigen::Quaterniond(eigen(p).toRotationMatrix()).coeffs());
    EXPECT_EQ(AngleAxis(p).angle_rad, Eigen::AngleAxisd(eigen(p)).angle());
    EXPECT_EQ(eigen(AngleAxis(p).axis), Eigen::AngleAxisd(eigen(p)).axis());
    EXPECT_EQ(p.angle_to(Quat(turn)), eigen(p).angularDistance(Eigen::Quaterniond(eigen(turn))));
  }
}

}  // namespace
}  // namespace selenograph
