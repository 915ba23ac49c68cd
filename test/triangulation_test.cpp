
#include "geometry/triangulation.h"

#include <gtest/gtest.h>

#include <limits>

#include "synthetic_scene.h"

namespace point_line_odometry {
namespace {

using Eigen::Vector2d;
using Eigen::Vector3d;

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();

/// Largest entry of the difference of two covariances, each in units of the standard deviations of
/// the second.
template <typename Matrix>
double relativeDifference(const Matrix& a, const Matrix& b) {
  double worst = 0.0;
  for (int r = 0; r < a.rows(); ++r) {
    for (int c = 0; c < a.cols(); ++c) {
      worst = std::max(worst, std::abs(a(r, c) - b(r, c)) / std::sqrt(b(r, r) * b(c, c)));
    }
  }
  return worst;
}

TEST(StereoCamera, HandNumbers) {
  const StereoCamera camera = synthetic::handCamera();
  const Vector3d p(1.0, -0.5, 5.0);
  EXPECT_NEAR((camera.projectLeft(p) - Vector2d(900.0, 50.0)).norm(), 0.0, 1e-12);
  EXPECT_NEAR((camera.projectRight(p) - Vector2d(750.0, 50.0)).norm(), 0.0, 1e-12);
}

TEST(BackProject, HandNumbers) {
  // f 1500 px, b 0.5 m, z 5 m: disparity 150 px.
  const Vector3d p = backProject(synthetic::handCamera(), {900.0, 50.0}, 150.0);
  EXPECT_NEAR((p - Vector3d(1.0, -0.5, 5.0)).norm(), 0.0, 1e-12);
}

TEST(BackProject, IsTheInverseOfTheProjection) {
  const StereoCamera camera = synthetic::camera();
  synthetic::Random random(1);
  for (int i = 0; i < 50; ++i) {
    const Vector3d p = synthetic::visiblePoint(camera, &random);
    const Vector2d left = camera.projectLeft(p);
    EXPECT_LT((backProject(camera, left, left.x() - camera.projectRight(p).x()) - p).norm(), 1e-9);
  }
}

TEST(TriangulatePoint, HandNumbers) {
  const auto point = triangulatePoint(synthetic::handCamera(), {600.0, 200.0}, 450.0, 0.3, 1.0);
  ASSERT_TRUE(point);
  EXPECT_NEAR((point->p_camera - Vector3d(0.0, 0.0, 5.0)).norm(), 0.0, 1e-12);
  // sigma_z = z / d * sqrt(2) sigma, sigma_y = z / f * sigma.
  EXPECT_NEAR(std::sqrt(point->covariance(2, 2)), 5.0 / 150.0 * std::sqrt(2.0) * 0.3, 1e-12);
  EXPECT_NEAR(std::sqrt(point->covariance(1, 1)), 5.0 / 1500.0 * 0.3, 1e-12);
}

TEST(TriangulatePoint, CovarianceAgreesWithMonteCarlo) {
  const StereoCamera camera = synthetic::camera();
  const Vector3d ground_truth(-1.2, 0.8, 6.0);
  const double sigma = 0.2;
  const Vector2d left = camera.projectLeft(ground_truth);
  const double right_u = camera.projectRight(ground_truth).x();
  const auto expected = triangulatePoint(camera, left, right_u, sigma, 1.0);
  ASSERT_TRUE(expected);
  synthetic::Random random(2);
  Eigen::Matrix3d sampled = Eigen::Matrix3d::Zero();
  constexpr int kSamples = 20000;
  for (int i = 0; i < kSamples; ++i) {
    const Vector2d noisy = left + random.normals<2>(sigma);
    const auto p = triangulatePoint(camera, noisy, right_u + random.normal(sigma), sigma, 1.0);
    const Vector3d error = p.value().p_camera - ground_truth;
    sampled += error * error.transpose() / kSamples;
  }
  EXPECT_LT(relativeDifference(sampled, expected->covariance), 0.04);
}

TEST(TriangulatePoint, RefusesSmallDisparity) {
  const StereoCamera camera = synthetic::camera();
  EXPECT_TRUE(triangulatePoint(camera, {100.0, 50.0}, 98.0, 0.3, 2.0));
  EXPECT_FALSE(triangulatePoint(camera, {100.0, 50.0}, 98.01, 0.3, 2.0));
  EXPECT_FALSE(triangulatePoint(camera, {100.0, 50.0}, 100.0, 0.3, 0.1));
  EXPECT_FALSE(triangulatePoint(camera, {100.0, 50.0}, 120.0, 0.3, 0.1));
}

TEST(TriangulatePoint, RefusesNaN) {
  const StereoCamera camera = synthetic::camera();
  EXPECT_FALSE(triangulatePoint(camera, {kNaN, 50.0}, 98.0, 0.3, 1.0));
  EXPECT_FALSE(triangulatePoint(camera, {100.0, 50.0}, kNaN, 0.3, 1.0));
}

TEST(TriangulateFarPoint, LiesInFrontForAnyDisparity) {
  const StereoCamera camera = synthetic::handCamera();
  const Vector2d left(100.0, 50.0);
  for (const double disparity : {-2.0, -0.1, 0.0, 0.1, 0.9}) {
    const auto p = triangulateFarPoint(camera, left, left.x() - disparity, 0.2);
    EXPECT_GT(p.p_camera.z(), 0.0) << disparity;
    EXPECT_TRUE(p.p_camera.allFinite() && p.covariance.allFinite()) << disparity;
    EXPECT_LT((camera.projectLeft(p.p_camera) - left).norm(), 1e-9) << disparity;
  }
}

TEST(TriangulateFarPoint, ShrinkageIsSmallForLargeDisparitiesAndAddedToTheNoise) {
  const StereoCamera camera = synthetic::handCamera();
  const Vector2d left(100.0, 50.0);
  const auto disparity = [&](const TriangulatedPoint& p) {
    return camera.fx * camera.baseline_m / p.p_camera.z();
  };
  const auto sigma = [&](const TriangulatedPoint& p) {  // of the disparity
    return std::sqrt(p.covariance(2, 2)) * disparity(p) / p.p_camera.z();
  };
  const auto clear = triangulateFarPoint(camera, left, left.x() - 0.9, 0.05);
  EXPECT_NEAR(disparity(clear), 0.9, 0.01);
  EXPECT_NEAR(sigma(clear), 0.05 * std::sqrt(2.0), 0.005);
  const auto vague = triangulateFarPoint(camera, left, left.x() - 0.2, 0.2);
  EXPECT_LT(disparity(vague), 0.1);
  EXPECT_GT(disparity(vague) + sigma(vague), 0.2);
  const auto wrong = triangulateFarPoint(camera, left, left.x() + 1.5, 0.2);  // behind infinity
  EXPECT_LT(disparity(wrong), 0.1);
  EXPECT_GT(sigma(wrong), 1.5);
}

// --- Lines

LineSegment segment(const Vector2d& start, const Vector2d& end) {
  return {start.cast<float>(), end.cast<float>()};
}

TEST(TriangulateLine, HandNumbers) {
  // Vertical, x 0 at z 5 m: columns 600 and 450; rows 50 and 350 are y -0.5 and 0.5 m.
  const auto line = triangulateLine(synthetic::handCamera(), segment({600.0, 50.0}, {600.0, 350.0}),
                                    segment({450.0, 50.0}, {450.0, 350.0}), 0.3, {});
  ASSERT_TRUE(line);
  EXPECT_NEAR((line->start_camera - Vector3d(0.0, -0.5, 5.0)).norm(), 0.0, 1e-6);
  EXPECT_NEAR((line->end_camera - Vector3d(0.0, 0.5, 5.0)).norm(), 0.0, 1e-6);
  EXPECT_NEAR(std::sqrt(line->covariance(2, 2)), 5.0 / 150.0 * std::sqrt(2.0) * 0.3, 1e-6);
  // No noise along the line: its y is exact here.
  EXPECT_NEAR(line->covariance(1, 1) - std::pow(0.5 / 150.0 * 0.3, 2) * 2.0, 0.0, 1e-9);
}

TEST(TriangulateLine, EndPointsNeedNotCorrespond) {
  const StereoCamera camera = synthetic::camera();
  const Vector3d a(-0.5, -0.8, 5.0);
  const Vector3d b(0.4, 0.9, 7.0);
  const Vector3d c = a + 0.2 * (b - a);  // the right segment is a part of it, longer at one end
  const Vector3d d = a + 1.1 * (b - a);
  const auto line =
      triangulateLine(camera, segment(camera.projectLeft(a), camera.projectLeft(b)),
                      segment(camera.projectRight(c), camera.projectRight(d)), 0.3, {});
  ASSERT_TRUE(line);
  EXPECT_LT((line->start_camera - a).norm(), 1e-4);
  EXPECT_LT((line->end_camera - b).norm(), 1e-4);
}

TEST(TriangulateLine, CovarianceAgreesWithMonteCarlo) {
  const StereoCamera camera = synthetic::camera();
  const Vector3d a(-0.5, -0.8, 5.0);
  const Vector3d b(0.9, 0.9, 7.0);
  const double sigma = 0.2;
  const std::array<Vector2d, 4> exact{camera.projectLeft(a), camera.projectLeft(b),
                                      camera.projectRight(a),
                                      camera.projectRight(a + 0.7 * (b - a))};
  const auto expected =
      triangulateLine(camera, segment(exact[0], exact[1]), segment(exact[2], exact[3]), sigma, {});
  ASSERT_TRUE(expected);
  Eigen::Matrix<double, 6, 1> ground_truth;
  ground_truth << a, b;
  synthetic::Random random(3);
  Matrix6d sampled = Matrix6d::Zero();
  constexpr int kSamples = 20000;
  for (int i = 0; i < kSamples; ++i) {
    std::array<Vector2d, 4> noisy;
    for (int k = 0; k < 4; ++k) {
      const Vector2d direction = exact[k < 2 ? 1 : 3] - exact[k < 2 ? 0 : 2];
      noisy[k] = synthetic::across(exact[k], direction, random.normal(sigma));
    }
    const auto line = triangulateLine(camera, segment(noisy[0], noisy[1]),
                                      segment(noisy[2], noisy[3]), sigma, {});
    Eigen::Matrix<double, 6, 1> error;
    error << line.value().start_camera, line->end_camera;
    error -= ground_truth;
    sampled += error * error.transpose() / kSamples;
  }
  EXPECT_LT(relativeDifference(sampled, expected->covariance), 0.05);
}

TEST(TriangulateLine, RefusesLinesNearTheEpipolarDirection) {
  const StereoCamera camera = synthetic::camera();
  LineTriangulationLimits limits;
  limits.min_angle_rad = 0.2;
  const auto triangulated = [&](double angle_left, double angle_right) {
    const Vector2d left(100.0 * std::cos(angle_left), 100.0 * std::sin(angle_left));
    const Vector2d right(100.0 * std::cos(angle_right), 100.0 * std::sin(angle_right));
    return triangulateLine(camera, segment({300.0, 100.0}, Vector2d(300.0, 100.0) + left),
                           segment({270.0, 100.0}, Vector2d(270.0, 100.0) + right), 0.3, limits)
        .has_value();
  };
  EXPECT_TRUE(triangulated(0.21, 0.21));
  EXPECT_FALSE(triangulated(0.19, 0.21));
  EXPECT_FALSE(triangulated(0.21, 0.19));
  EXPECT_FALSE(triangulated(0.0, 0.0));
  EXPECT_FALSE(triangulated(3.14159, 3.14159));
  EXPECT_TRUE(triangulated(3.14159 + 0.21, 3.14159 + 0.21));
}

TEST(TriangulateLine, LimitsTheExtrapolation) {
  const StereoCamera camera = synthetic::camera();
  LineTriangulationLimits limits;
  limits.max_extrapolation = 0.5;
  const LineSegment left = segment({300.0, 100.0}, {300.0, 200.0});
  const auto with = [&](double from, double to) {
    return triangulateLine(camera, left, segment({270.0, from}, {270.0, to}), 0.3, limits)
        .has_value();
  };
  EXPECT_TRUE(with(100.0, 167.0));   // extended by 33 of 67 px
  EXPECT_FALSE(with(100.0, 166.0));  // 34 of 66
  EXPECT_TRUE(with(133.0, 200.0));
  EXPECT_FALSE(with(134.0, 200.0));
  EXPECT_FALSE(with(250.0, 350.0));  // no common rows, by half of itself and more
  EXPECT_TRUE(with(50.0, 400.0));    // a longer one needs no extension
}

TEST(TriangulateLine, LimitsTheDisparityAtBothEnds) {
  const StereoCamera camera = synthetic::camera();
  LineTriangulationLimits limits;
  limits.min_disparity_px = 2.0;
  limits.max_disparity_px = 50.0;
  const LineSegment left = segment({300.0, 100.0}, {300.0, 200.0});
  const auto with = [&](double disparity_start, double disparity_end) {
    const LineSegment right =
        segment({300.0 - disparity_start, 100.0}, {300.0 - disparity_end, 200.0});
    return triangulateLine(camera, left, right, 0.3, limits).has_value();
  };
  EXPECT_TRUE(with(2.1, 49.9));
  EXPECT_FALSE(with(1.9, 10.0));
  EXPECT_FALSE(with(10.0, 1.9));
  EXPECT_FALSE(with(50.1, 10.0));
  EXPECT_FALSE(with(10.0, 50.1));
  EXPECT_FALSE(with(-10.0, -10.0));
}

TEST(TriangulateLine, RefusesInvalidSegments) {
  const StereoCamera camera = synthetic::camera();
  const LineSegment left = segment({300.0, 100.0}, {300.0, 200.0});
  const LineSegment right = segment({270.0, 100.0}, {270.0, 200.0});
  ASSERT_TRUE(triangulateLine(camera, left, right, 0.3, {}));
  const LineSegment dot = segment({270.0, 100.0}, {270.0, 100.0});
  EXPECT_FALSE(triangulateLine(camera, left, dot, 0.3, {}));
  EXPECT_FALSE(triangulateLine(camera, dot, right, 0.3, {}));
  const LineSegment nan = segment({kNaN, 100.0}, {270.0, 200.0});
  EXPECT_FALSE(triangulateLine(camera, left, nan, 0.3, {}));
  EXPECT_FALSE(triangulateLine(camera, nan, right, 0.3, {}));
  const LineSegment turned = segment({270.0, 1e9}, {270.0, -1e9});
  const auto huge = triangulateLine(camera, left, turned, 0.3, {});
  EXPECT_TRUE(!huge || (huge->covariance.allFinite() && huge->start_camera.allFinite()));
}

}  // namespace
}  // namespace point_line_odometry
