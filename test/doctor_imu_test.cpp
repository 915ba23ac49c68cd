/// What the doctor finds out about an IMU: axes, time offset, saturated samples.

#include "ros/doctor_imu.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <random>

#include "geometry/se3.h"

namespace point_line_odometry {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;

constexpr std::int64_t kSecond = 1000000000;

struct Case {
  Matrix3d R_really = Matrix3d::Identity();  ///< axes of the IMU in those that tf has
  double offset_s = 0.0;
  double turns = 1.0;  ///< factor on the rates
  bool one_axis = false;
  double clipped_rad_s = 1e9;
  double noise_rad_s = 0.01;  ///< of the images
};

Vector3d rateOfCamera(double t, const Case& c) {
  const Vector3d rate(0.5 * std::sin(2.1 * t), 0.4 * std::cos(1.3 * t),
                      0.3 * std::sin(3.7 * t + 1.0));
  return c.turns * (c.one_axis ? Vector3d(0.0, rate.y(), 0.0) : rate);
}

const Matrix3d kR_camera_imu = expSO3({0.2, -1.4, 0.6});

ImuCheckFacts measured(const Case& c, ImuParameters parameters = {}) {
  std::mt19937 random(4);
  std::normal_distribution<double> normal;
  ImuCheckFacts facts;
  facts.topic = "/stereo/imu";
  facts.frame = "imu";
  facts.parameters = parameters;
  facts.R_camera_imu = kR_camera_imu;
  const Vector3d bias(0.03, -0.05, 0.02);
  for (double t = -1.0; t < 4.0; t += 0.005) {
    ImuSample sample;
    sample.stamp_ns = 50 * kSecond + std::llround(1e9 * (t + c.offset_s));
    const Vector3d true_axes =
        c.R_really.transpose() * kR_camera_imu.transpose() * rateOfCamera(t, c);
    sample.angular_velocity =
        (true_axes + bias).cwiseMax(-c.clipped_rad_s).cwiseMin(c.clipped_rad_s);
    facts.samples.push_back(sample);
  }
  std::vector<ImageMotion> motions;
  std::vector<std::int64_t> ends;
  for (int k = 0; k < 60; ++k) {
    ImageMotion motion;
    motion.from_ns = 50 * kSecond + k * kSecond / 20;
    const double middle_s = (k + 0.5) / 20.0;
    Vector3d rate = rateOfCamera(middle_s, c);
    for (int i = 0; i < 3; ++i) rate[i] += c.noise_rad_s * normal(random);
    motion.T_prev_curr.linear() = expSO3(0.05 * rate);
    motions.push_back(motion);
    ends.push_back(motion.from_ns + kSecond / 20);
  }
  facts.fit = fitRates(facts.samples, motions, ends, *facts.R_camera_imu, parameters);
  return facts;
}

std::vector<Matrix3d> allAxes() {
  std::vector<Matrix3d> all;
  std::array<int, 3> order{0, 1, 2};
  do {
    for (int signs = 0; signs < 8; ++signs) {
      Matrix3d R = Matrix3d::Zero();
      for (int i = 0; i < 3; ++i)
        R(i, order.at(static_cast<std::size_t>(i))) = (signs >> i) % 2 == 0 ? 1.0 : -1.0;
      if (R.determinant() > 0.0) all.push_back(R);
    }
  } while (std::next_permutation(order.begin(), order.end()));
  return all;
}

TEST(DoctorImu, NamesEachOfThe24Rotations) {
  ASSERT_EQ(allAxes().size(), 24U);
  for (const Matrix3d& R : allAxes()) {
    Case c;
    c.R_really = R;
    const ImuCheckFacts facts = measured(c);
    ASSERT_TRUE(facts.fit);
    const DoctorLine line = checkImu(facts);
    if (R.isIdentity()) {
      EXPECT_EQ(line.level, DoctorLevel::kOk) << line.text;
      EXPECT_TRUE(facts.fit->better.empty());
      continue;
    }
    EXPECT_EQ(line.level, DoctorLevel::kWarn) << R;
    ASSERT_EQ(facts.fit->better.size(), 1U) << R;
    EXPECT_TRUE(facts.fit->better.front().isApprox(R)) << R << "\n" << line.hint;
  }
}

TEST(DoctorImu, TurnsAboutOneAxisLeaveFourRotations) {
  Case c;
  c.one_axis = true;
  c.noise_rad_s = 0.003;
  // In the camera's axes, so that the turns are about one of the axes.
  c.R_really =
      kR_camera_imu.transpose() * Eigen::AngleAxisd(M_PI, Vector3d::UnitY()) * kR_camera_imu;
  EXPECT_EQ(checkImu(measured(c)).level, DoctorLevel::kOk) << "nothing tells it from the right one";
}

TEST(DoctorImu, NoFalseAlarm) {
  for (const double turns : {0.02, 0.2, 1.0, 3.0}) {
    for (const double offset_s : {-0.03, 0.0, 0.02}) {
      Case c;
      c.turns = turns;
      c.offset_s = offset_s;
      const DoctorLine line = checkImu(measured(c));
      EXPECT_EQ(line.level, DoctorLevel::kOk) << turns << " " << offset_s << ": " << line.text;
    }
  }
}

TEST(DoctorImu, TellsALargeTimeOffset) {
  for (const double offset_s : {-0.15, 0.12}) {
    Case c;
    c.offset_s = offset_s;
    const ImuCheckFacts facts = measured(c);
    const DoctorLine line = checkImu(facts);
    EXPECT_EQ(line.level, DoctorLevel::kWarn) << line.text;
    EXPECT_NE(line.text.find("stamps"), std::string::npos) << line.text;
    EXPECT_NEAR(facts.fit->time_offset_s, offset_s, 0.011);
  }
  ImuParameters given;
  given.estimate_time_offset = false;
  Case late;
  late.offset_s = 0.04;
  EXPECT_EQ(checkImu(measured(late, given)).level, DoctorLevel::kWarn);
  given.time_offset_s = 0.04;
  EXPECT_EQ(checkImu(measured(late, given)).level, DoctorLevel::kOk);
}

TEST(DoctorImu, TellsSaturatedSamples) {
  Case c;
  c.turns = 6.0;
  c.clipped_rad_s = 1.5;
  const DoctorLine line = checkImu(measured(c));
  EXPECT_EQ(line.level, DoctorLevel::kWarn);
  EXPECT_NE(line.text.find("saturated"), std::string::npos) << line.text;
  ImuParameters narrow;
  narrow.range_deg_s = 100.0;
  c.clipped_rad_s = 1e9;
  EXPECT_NE(checkImu(measured(c, narrow)).text.find("saturated"), std::string::npos);
  EXPECT_EQ(checkImu(measured(c)).level, DoctorLevel::kOk) << "fast, but within the range";
}

TEST(DoctorImu, TellsWhatIsMissing) {
  ImuCheckFacts facts;
  facts.topic = "/stereo/imu";
  EXPECT_NE(checkImu(facts).text.find("nothing arrives on /stereo/imu"), std::string::npos);
  facts = measured({});
  facts.R_camera_imu.reset();
  EXPECT_EQ(checkImu(facts).level, DoctorLevel::kUnknown) << "it is not in use";
  facts.parameters.enabled = true;
  EXPECT_EQ(checkImu(facts).level, DoctorLevel::kWarn);
  EXPECT_NE(checkImu(facts).text.find("tf does not know"), std::string::npos);
  facts = measured({});
  for (ImuSample& sample : facts.samples)
    sample.angular_velocity = sample.angular_velocity.cwiseAbs2();
  facts.fit.reset();
  EXPECT_NE(checkImu(facts).text.find("not checked"), std::string::npos);
}

}  // namespace
}  // namespace point_line_odometry
