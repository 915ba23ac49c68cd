/// The samples of other sensors that offline_odometry hands to the odometry.

#include "tools/offline_run.h"

#include <gtest/gtest.h>

#include <cstdint>
#include <opencv2/core.hpp>
#include <optional>
#include <vector>

namespace point_line_odometry {
namespace {

constexpr std::int64_t kFramePeriod_ns = 100'000'000;
constexpr std::int64_t kSamplePeriod_ns = 1'000'000;

/// Black images, which show no motion, and wheels at 1 kHz.
class DarkSource : public StereoSource {
 public:
  DarkSource(int frames, std::int64_t wheels_begin_ns) : frames_(frames) {
    for (CameraCalibration* camera : {&calibration_.left, &calibration_.right}) {
      camera->width = 64;
      camera->height = 48;
      camera->P << 50.0, 0.0, 32.0, 0.0, 0.0, 50.0, 24.0, 0.0, 0.0, 0.0, 1.0, 0.0;
      camera->K = camera->P.leftCols<3>();
    }
    calibration_.right.P(0, 3) = -5.0;
    for (std::int64_t t = wheels_begin_ns; t < frames * kFramePeriod_ns; t += kSamplePeriod_ns) {
      OdometrySample sample;
      sample.stamp_ns = t;
      sample.T_odom_body.translation().x() = 1e-9 * static_cast<double>(t);
      wheels_.samples.push_back(sample);
    }
  }

  std::size_t size() const override { return static_cast<std::size_t>(frames_); }
  const StereoCalibration& calibration() const override { return calibration_; }
  bool needsRectification() const override { return false; }
  std::optional<WheelData> wheels() override { return wheels_; }

  std::optional<StereoImages> next() override {
    if (next_ == frames_) return std::nullopt;
    const cv::Mat black = cv::Mat::zeros(48, 64, CV_8UC1);
    return StereoImages{black, black, next_++ * kFramePeriod_ns};
  }

  std::vector<OdometrySample>& samples() { return wheels_.samples; }

 private:
  int frames_;
  int next_ = 0;
  StereoCalibration calibration_;
  WheelData wheels_;
};

/// Number of frames that had a prior.
std::size_t framesWithPrior(DarkSource* source) {
  Parameters parameters;
  parameters.wheels.enabled = true;
  parameters.tracking.max_prior_prediction_s = 60.0;
  OfflineRun run(*source, parameters, nullptr);
  while (run.step()) {
  }
  std::size_t count = 0;
  for (const FrameRow& row : run.rows()) count += row.prior.use != PriorUse::kNone ? 1 : 0;
  return count;
}

/// More samples than are kept.
constexpr int kFrames = 300;

TEST(OfflineRun, EachFrameHasThePriorOfTheWheels) {
  DarkSource source(kFrames, 0);
  EXPECT_EQ(framesWithPrior(&source), kFrames - 1U) << "all but the first";
}

TEST(OfflineRun, WheelsThatBeginLaterAreUsedFromThenOn) {
  DarkSource source(kFrames, 350'000'000);
  EXPECT_EQ(framesWithPrior(&source), kFrames - 5U);
}

TEST(OfflineRun, AGapCostsTheFramesAroundIt) {
  DarkSource source(kFrames, 0);
  auto& samples = source.samples();
  samples.erase(samples.begin() + 2050, samples.begin() + 2750);
  const std::size_t with_gap = framesWithPrior(&source);
  EXPECT_GE(with_gap, kFrames - 1U - 10U);
  EXPECT_LT(with_gap, kFrames - 1U);
}

TEST(OfflineRun, ASampleWithAWildStampChangesNothing) {
  DarkSource source(kFrames, 0);
  auto& samples = source.samples();
  samples[100].stamp_ns = 4'000'000'000'000'000'000;
  EXPECT_EQ(framesWithPrior(&source), kFrames - 1U);
}

}  // namespace
}  // namespace point_line_odometry
