
#include "motion/observations.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>
#include <optional>
#include <utility>

#include "geometry/rolling_shutter.h"
#include "matching/patch_aligner.h"
#include "motion/frame_context.h"
#include "point_line_odometry/parameters.h"
#include "point_line_odometry/stereo_correction.h"
#include "point_line_odometry/types.h"
#include "synthetic_scene.h"

namespace point_line_odometry {
namespace {

using Eigen::Vector2f;

constexpr int kSize = 400;
constexpr double kAmplitude = 4.0;

/// Blurred texture of low contrast, defined at every position: p without a shift is p + shift with
/// it.
cv::Mat faintWaves(const Vector2f& shift, double noise, unsigned noise_seed) {
  synthetic::Random random(1);
  struct Wave {
    double kx, ky, phase;
  };
  std::vector<Wave> all;
  for (int i = 0; i < 12; ++i) {
    const double direction = random.uniform(0.0, 2.0 * M_PI);
    const double frequency = 2.0 * M_PI / random.uniform(15.0, 45.0);
    all.push_back({frequency * std::cos(direction), frequency * std::sin(direction),
                   random.uniform(0.0, 6.0)});
  }
  cv::Mat image(kSize, kSize, CV_32FC1);
  for (int y = 0; y < kSize; ++y) {
    for (int x = 0; x < kSize; ++x) {
      double value = 0.0;
      for (const Wave& wave : all)
        value += std::sin(wave.kx * (x - shift.x()) + wave.ky * (y - shift.y()) + wave.phase);
      image.at<float>(y, x) = static_cast<float>(100.0 + kAmplitude * value);
    }
  }
  cv::Mat grain(image.size(), CV_32FC1);
  cv::RNG(noise_seed).fill(grain, cv::RNG::NORMAL, 0.0, noise);
  image += grain;
  image.convertTo(image, CV_8UC1);
  return image;
}

PointParameters threeLevels() {
  PointParameters parameters;
  parameters.levels = 3;
  parameters.scale_factor = 2.0;
  return parameters;
}

/// Errors of an alignment [px of the image] at several positions, and its estimates of the noise;
/// where it fails the error is 100.
struct Errors {
  std::vector<double> errors_px;
  double mean_noise_px = 0.0;

  double quantile(double share) {
    std::sort(errors_px.begin(), errors_px.end());
    return errors_px[static_cast<std::size_t>(share * static_cast<double>(errors_px.size() - 1))];
  }
  double rms() const {
    double sum = 0.0;
    for (const double error : errors_px) sum += error * error;
    return std::sqrt(sum / static_cast<double>(errors_px.size()));
  }
};

Errors alignmentErrors(int octave, double noise) {
  const Vector2f shift(6.3F, -4.6F);
  const ImagePyramid before(faintWaves(Vector2f::Zero(), noise, 11), threeLevels());
  const ImagePyramid after(faintWaves(shift, noise, 12), threeLevels());
  Errors result;
  int found = 0;
  for (int y = 60; y <= 340; y += 40) {
    for (int x = 60; x <= 340; x += 40) {
      const Vector2f pixel(static_cast<float>(x), static_cast<float>(y));
      const PatchAligner patch(before.levels[static_cast<std::size_t>(octave)],
                               before.toLevel(pixel, octave));
      const auto aligned =
          alignInOctave(patch, after, {}, octave, pixel + shift + Vector2f(1.5F, -1));
      result.errors_px.push_back(aligned ? (aligned->pixel - pixel - shift).norm() : 100.0);
      if (!aligned) continue;
      ++found;
      result.mean_noise_px += aligned->noise_px;
    }
  }
  result.mean_noise_px /= std::max(found, 1);
  return result;
}

TEST(AlignInOctave, IsExactInEveryOctave) {
  for (const int octave : {0, 1, 2}) {
    Errors clean = alignmentErrors(octave, 0.0);
    EXPECT_LT(clean.quantile(0.9), 0.06 * (1 << octave)) << octave;
  }
}

TEST(AlignInOctave, CoarserLevelsAverageOutNoise) {
  constexpr double kNoise = 8.0;
  Errors fine = alignmentErrors(0, kNoise);
  Errors coarse = alignmentErrors(2, kNoise);
  EXPECT_GT(fine.quantile(0.5), 1.0);
  EXPECT_LT(coarse.quantile(0.9), 1.0);  // a quarter of a pixel of the level
}

TEST(AlignInOctave, NoiseIsInPixelsOfTheImage) {
  for (const int octave : {1, 2}) {
    const Errors errors = alignmentErrors(octave, 4.0);
    const double noise_px = errors.rms() / std::sqrt(2.0);  // of a coordinate
    EXPECT_GT(errors.mean_noise_px, 0.5 * noise_px) << octave;
    EXPECT_LT(errors.mean_noise_px, 2.5 * noise_px) << octave;
  }
}

TEST(AlignInOctave, AMissingOctaveGivesNothing) {
  const ImagePyramid pyramid(faintWaves(Vector2f::Zero(), 0.0, 1), threeLevels());
  const Vector2f middle(200.0F, 200.0F);
  const PatchAligner patch(pyramid.levels[0], middle);
  EXPECT_TRUE(alignInOctave(patch, pyramid, {}, 0, middle));
  EXPECT_FALSE(alignInOctave(patch, pyramid, {}, 3, middle));
}

TEST(AlignPoint, UsesTheOctaveOfThePatch) {
  // A stereo pair of a wall: the right image is the left one moved by a disparity.
  const Vector2f disparity(12.0F, 0.0F);
  const StereoImages images{faintWaves(Vector2f::Zero(), 2.0, 1), faintWaves(-disparity, 2.0, 2),
                            0};
  StereoCamera camera = synthetic::camera();
  camera.width = camera.height = kSize;
  const StereoCorrection correction;
  Parameters parameters;
  parameters.points = threeLevels();
  FrameContext context{images, camera, correction, parameters};
  context.left.addLevels(parameters.points);
  context.right.addLevels(parameters.points);
  const Vector2f pixel(181.0F, 213.0F);
  for (const int octave : {0, 1, 2}) {
    const StereoPatch patch(PatchAligner(context.left.levels[static_cast<std::size_t>(octave)],
                                         context.left.toLevel(pixel, octave)));
    const auto observation = alignPoint(patch, octave, pixel + Vector2f(1.0F, 0.7F),
                                        pixel - disparity + Vector2f(1.0F, 0.7F), context);
    ASSERT_TRUE(observation) << octave;
    EXPECT_LT((observation->left_px - pixel.cast<double>()).norm(), 0.05 * (1 << octave)) << octave;
    EXPECT_LT((observation->right_px - (pixel - disparity).cast<double>()).norm(), 0.6) << octave;
    // motion/point_noise_px is in pixels of the level.
    const double floor_px = (1 << octave) * parameters.motion.point_noise_px;
    EXPECT_GE(observation->sigma_px, floor_px) << octave;
    EXPECT_LT(observation->sigma_px, 0.5 * (1 << octave)) << octave;
  }
}

/// What a rolling shutter has seen, as of the stamp.
class AtTheStamp : public ::testing::Test {
 protected:
  AtTheStamp() {
    Vector6d velocity;
    velocity << 2.0, 0.5, 8.0, 0.4, -1.0, 0.6;
    context_.shutter = RollingShutter(0.03, velocity, Vector6d::Zero(), true);
  }

  /// Left and right pixel of a point in the camera at the stamp, when its row is exposed.
  std::pair<Vector2f, Vector2f> seen(const Eigen::Vector3d& p) const {
    const Eigen::Vector3d exposed = context_.shutter.whenExposed(camera_, p);
    return {camera_.projectLeft(exposed).cast<float>(),
            camera_.projectRight(exposed).cast<float>()};
  }

  StereoCamera camera_ = synthetic::camera();
  Parameters parameters_;
  StereoImages images_;
  FrameContext context_{images_, camera_, StereoCorrection(), parameters_};
};

TEST_F(AtTheStamp, PointsAreWhereTheyWere) {
  synthetic::Random random(5);
  double most_moved_px = 0.0;
  for (int i = 0; i < 100; ++i) {
    const Eigen::Vector3d p = synthetic::visiblePoint(camera_, &random);
    const auto [left_px, right_px] = seen(p);
    const Vector2f vertical(0.0F, 0.4F);
    const PointObservation point = pointObservation(left_px, right_px + vertical, 0.3, context_);
    EXPECT_LT((point.left_px - camera_.projectLeft(p)).norm(), 0.03) << i;
    EXPECT_NEAR(point.right_px.x(), camera_.projectRight(p).x(), 0.03) << i;
    EXPECT_NEAR(point.right_px.y() - point.left_px.y(), 0.4, 1e-4)
        << "a vertical disparity remains";
    most_moved_px = std::max(most_moved_px, (point.left_px - left_px.cast<double>()).norm());
  }
  EXPECT_GT(most_moved_px, 5.0);
}

/// Ends of the two segments that are not the same point of the line, too.
TEST_F(AtTheStamp, LinesAreWhereTheyWere) {
  synthetic::Random random(6);
  int tried = 0;
  for (int i = 0; i < 100; ++i) {
    const Eigen::Vector3d start = synthetic::visiblePoint(camera_, &random);
    const Eigen::Vector3d end = synthetic::visiblePoint(camera_, &random);
    // A short piece: the image of a long one is bent by the read-out.
    const Eigen::Vector3d along = 0.3 * (end - start).normalized();
    const auto at = [&](double share) { return Eigen::Vector3d(start + share * along); };
    const Eigen::Vector2d direction = camera_.projectLeft(at(1.0)) - camera_.projectLeft(at(0.0));
    const double slope = std::abs(direction.y()) / std::abs(direction.x());
    const bool is_level = slope < 0.1;
    if (!is_level && slope < 0.5) continue;  // its partners in a row are hardly known
    ++tried;
    // The ends of a level line have the disparity of its middle.
    const double most_px = is_level ? 0.5 : 0.1;
    DetectedFeatures features;
    features.lines_left.push_back({{seen(at(0.0)).first, seen(at(1.0)).first}, {}});
    features.lines_right.push_back({{seen(at(0.1)).second, seen(at(0.9)).second}, {}});
    const LineObservation line = lineObservation(features, {0, 0, std::nullopt}, context_);
    EXPECT_LT((line.left_start_px - camera_.projectLeft(at(0.0))).norm(), most_px) << i;
    EXPECT_LT((line.left_end_px - camera_.projectLeft(at(1.0))).norm(), most_px) << i;
    EXPECT_LT((line.right_start_px - camera_.projectRight(at(0.1))).norm(), most_px) << i;
    EXPECT_LT((line.right_end_px - camera_.projectRight(at(0.9))).norm(), most_px) << i;
  }
  EXPECT_GT(tried, 30);
}

}  // namespace
}  // namespace point_line_odometry
