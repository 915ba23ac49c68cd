/// What consecutive pairs tell of their cameras: the built-in world with a right camera that is
/// late, with a rolling shutter, and with a projector's pattern that rests in the image.

#include "checks/sequence_check.h"

#include <gtest/gtest.h>

#include <cmath>
#include <iostream>
#include <opencv2/imgproc.hpp>
#include <optional>
#include <random>
#include <string>
#include <vector>

#include "checks/read_out.h"
#include "point_line_odometry/rectification.h"
#include "world/synthetic_world.h"

namespace point_line_odometry {
namespace {

constexpr int kFrames = 30;

/// Rectified pairs of a scene at about its own rate; the right ones are taken some time later.
class LateCamera {
 public:
  LateCamera(const std::string& scene, double delay_ms)
      : world_(optionsOf(scene)), delay_(static_cast<int>(std::lround(delay_ms / kTick_ms))) {
    if (world_.needsRectification()) rectifier_.emplace(world_.calibration());
  }

  StereoImages pair(int i) const {
    constexpr int kFirst = 60;
    const int tick = kFirst + i * kTicks;
    StereoImages images = world_.render(tick);
    if (delay_ != 0) images.right = world_.render(tick + delay_).right;
    return rectifier_ ? rectifier_->rectify(images) : images;
  }

 private:
  static constexpr double kTick_ms = 5.0;
  static constexpr int kTicks = 10;  // from pair to pair: 50 ms

  static SyntheticWorldOptions optionsOf(const std::string& scene) {
    SyntheticWorldOptions options;
    options.scene = scene;
    options.frame_rate_hz = 1000.0 / kTick_ms;
    return options;
  }

  SyntheticWorld world_;
  int delay_;
  std::optional<StereoRectifier> rectifier_;
};

SequenceMeasurement measure(const std::string& scene, double delay_ms) {
  const LateCamera camera(scene, delay_ms);
  SequenceCheck check;
  for (int i = 0; i < kFrames; ++i) check.add(camera.pair(i));
  const SequenceMeasurement measurement = check.measurement();
  std::cout << scene << ", " << delay_ms << " ms late: " << 1e3 * measurement.delay_s.value_or(NAN)
            << " +- " << 1e3 * measurement.delay_sigma_s << " ms; " << measurement.pattern.resting
            << " of " << measurement.pattern.compared << " rest\n";
  return measurement;
}

void expectDelay(const std::string& scene, double delay_ms, double tolerance_ms) {
  const SequenceMeasurement measurement = measure(scene, delay_ms);
  ASSERT_TRUE(measurement.delay_s);
  EXPECT_NEAR(1e3 * *measurement.delay_s, delay_ms, tolerance_ms);
  EXPECT_EQ(measurement.notSimultaneous(), delay_ms != 0.0);
  EXPECT_FALSE(measurement.pattern.isThere());
  EXPECT_GT(measurement.pattern.compared, 100);
}

TEST(SequenceCheck, MeasuresTheDelayOfAFlight) {
  expectDelay("indoor", 0.0, 0.3);
  expectDelay("indoor", 10.0, 0.5);
  expectDelay("indoor", -5.0, 0.5);
}

TEST(SequenceCheck, MeasuresTheDelayOfADrive) {
  expectDelay("street", 0.0, 0.3);
  expectDelay("street", 10.0, 0.6);
}

TEST(SequenceCheck, MeasuresTheDelayAlongPlainWalls) {
  expectDelay("corridor", 0.0, 1.5);
  expectDelay("corridor", 5.0, 1.5);
}

/// Images as a camera takes them.
struct Sequence {
  SyntheticWorldOptions options;
  StereoCalibration calibration;
  bool is_raw = false;
  std::vector<StereoImages> images;
};

Sequence render(const SyntheticWorldOptions& options, int frames = 60, int first = 60) {
  const SyntheticWorld world(options);
  Sequence sequence{options, world.calibration(), world.needsRectification(), {}};
  for (int i = first; i < first + frames; ++i)
    sequence.images.push_back(world.render(static_cast<std::size_t>(i)));
  return sequence;
}

TEST(SequenceCheck, FewPairsFarApartAreNotBlamed) {
  SyntheticWorldOptions options;
  options.frame_rate_hz = 2.0;
  const std::size_t pairs = 12;
  const Sequence sequence = render(options, 66, 0);
  int told = 0;
  for (std::size_t first = 0; first + pairs <= sequence.images.size(); first += 6) {
    SequenceCheck check;
    for (std::size_t i = first; i < first + pairs; ++i) check.add(sequence.images[i]);
    const SequenceMeasurement measurement = check.measurement();
    EXPECT_FALSE(measurement.notSimultaneous())
        << "from pair " << first << ": " << 1e3 * *measurement.delay_s << " +- "
        << 1e3 * measurement.delay_sigma_s << " ms";
    told += measurement.delay_s ? 1 : 0;
  }
  EXPECT_GT(told, 0) << "nothing was measured";
}

/// \param wrong_k1 is added to the first coefficient of the distortion.
SequenceMeasurement measureShutter(const Sequence& sequence, double wrong_k1 = 0.0) {
  StereoCalibration calibration = sequence.calibration;
  if (wrong_k1 != 0.0) {
    calibration.left.D.at(0) += wrong_k1;
    calibration.right.D.at(0) += wrong_k1;
  }
  std::optional<StereoRectifier> rectifier;
  if (sequence.is_raw) rectifier.emplace(calibration);
  SequenceCheck check(calibration.left);
  for (const StereoImages& images : sequence.images)
    check.add(rectifier ? rectifier->rectify(images) : images);
  const SequenceMeasurement measurement = check.measurement();
  std::cout << sequence.options.scene << ", read-out of " << sequence.options.rolling_shutter_ms
            << " ms: " << 1e3 * measurement.read_out_s.value_or(NAN) << " +- "
            << 1e3 * measurement.read_out_sigma_s << " ms\n";
  return measurement;
}

/// A camera that is turned to and fro by hand, or on a rough road.
SyntheticWorldOptions shaken(const std::string& scene, double read_out_ms) {
  SyntheticWorldOptions options;
  options.scene = scene;
  options.rotation = 4.0;
  options.rolling_shutter_ms = read_out_ms;
  return options;
}

/// Within three standard deviations, and these are as small as said.
void expectReadOut(const SequenceMeasurement& measurement, double read_out_ms, double sigma_ms) {
  ASSERT_TRUE(measurement.read_out_s);
  EXPECT_NEAR(1e3 * *measurement.read_out_s, read_out_ms, 3e3 * measurement.read_out_sigma_s);
  EXPECT_LT(1e3 * measurement.read_out_sigma_s, sigma_ms);
  EXPECT_EQ(measurement.hasRollingShutter(), read_out_ms != 0.0);
  EXPECT_FALSE(measurement.notSimultaneous());
  EXPECT_FALSE(measurement.pattern.isThere());
}

TEST(SequenceCheck, MeasuresTheReadOutOfARollingShutter) {
  expectReadOut(measureShutter(render(shaken("corridor", 30.0))), 30.0, 6.0);
  expectReadOut(measureShutter(render(shaken("street", 30.0))), 30.0, 3.0);
}

TEST(SequenceCheck, TakesAWrongCalibrationForNoRollingShutter) {
  constexpr double kWrong = 0.01;  // 2 px in the corners
  for (const double read_out_ms : {0.0, -30.0}) {
    const Sequence sequence = render(shaken("indoor", read_out_ms));
    expectReadOut(measureShutter(sequence), read_out_ms, 6.0);
    EXPECT_EQ(measureShutter(sequence, kWrong).hasRollingShutter(), read_out_ms != 0.0);
    SequenceCheck without_camera;
    for (const StereoImages& images : sequence.images) without_camera.add(images);
    EXPECT_FALSE(without_camera.measurement().read_out_s);
  }
}

TEST(SequenceCheck, FindsNoRollingShutterInTheScenesThemselves) {
  for (const char* scene : {"street", "corridor"}) {
    SyntheticWorldOptions options;
    options.scene = scene;
    EXPECT_FALSE(measureShutter(render(options)).hasRollingShutter()) << scene;
  }
}

TEST(SequenceCheck, LooksForNoRollingShutterWithoutMotion) {
  SyntheticWorldOptions options = shaken("indoor", 20.0);
  options.speed = 0.0;
  options.rotation = 0.0;
  const Sequence sequence = render(options, 10);
  EXPECT_FALSE(measureShutter(sequence).hasRollingShutter());
  EXPECT_FALSE(measureReadOut({}, sequence.calibration.left));
}

TEST(SequenceCheck, SaysNothingOfACameraThatStands) {
  SyntheticWorldOptions options;
  options.scene = "indoor";
  options.speed = 0.0;
  options.rotation = 0.0;
  const SyntheticWorld world(options);
  SequenceCheck check;
  for (int i = 0; i < 10; ++i) check.add(world.render(i));
  const SequenceMeasurement measurement = check.measurement();
  EXPECT_FALSE(measurement.notSimultaneous());
  EXPECT_FALSE(measurement.pattern.isThere());
  EXPECT_EQ(measurement.pattern.compared, 0);
}

/// A dot is at a fixed pixel of the left image, next to the projector, and in the right one where
/// the surface that it falls on is.
class Projector {
 public:
  explicit Projector(cv::Size size) {
    constexpr int kPitch_px = 36;
    std::mt19937 random(7);
    for (int y = kPitch_px; y < size.height - kPitch_px; y += kPitch_px) {
      for (int x = kPitch_px; x < size.width - kPitch_px; x += kPitch_px) {
        const auto shift = [&] { return static_cast<int>(random() % 25U) - 12; };
        const int dx = shift();
        const int dy = shift();
        dots_.emplace_back(x + dx, y + dy);
      }
    }
  }

  StereoImages light(const StereoImages& scene) const {
    StereoImages lit = scene;
    lit.left = scene.left.clone();
    lit.right = scene.right.clone();
    for (const cv::Point& dot : dots_) {
      draw(dot, &lit.left);
      const int disparity = disparityAt(scene, dot);
      if (disparity >= 0) draw(dot - cv::Point(disparity, 0), &lit.right);
    }
    return lit;
  }

 private:
  /// Adds the light of a dot of a few pixels.
  static void draw(const cv::Point& dot, cv::Mat* image) {
    cv::Mat light(image->size(), CV_8UC1, cv::Scalar(0));
    cv::circle(light, dot, 2, cv::Scalar(110), cv::FILLED, cv::LINE_AA);
    cv::add(*image, light, *image);
  }

  static int disparityAt(const StereoImages& scene, const cv::Point& dot) {
    constexpr int kRadius_px = 5;
    constexpr int kMost_px = 80;
    const cv::Rect patch(dot.x - kRadius_px, dot.y - kRadius_px, 2 * kRadius_px + 1,
                         2 * kRadius_px + 1);
    const int most = std::min(kMost_px, patch.x);
    const cv::Rect strip(patch.x - most, patch.y, patch.width + most, patch.height);
    cv::Mat scores;
    cv::matchTemplate(scene.right(strip), scene.left(patch), scores, cv::TM_CCOEFF_NORMED);
    double best = 0.0;
    cv::Point at;
    cv::minMaxLoc(scores, nullptr, &best, nullptr, &at);
    return best > 0.7 ? most - at.x : -1;
  }

  std::vector<cv::Point> dots_;
};

TEST(SequenceCheck, FindsThePatternOfAProjector) {
  for (const char* scene : {"indoor", "corridor"}) {
    const LateCamera camera(scene, 0.0);
    const Projector projector(camera.pair(0).left.size());
    SequenceCheck check;
    for (int i = 0; i < kFrames; ++i) check.add(projector.light(camera.pair(i)));
    const SequenceMeasurement measurement = check.measurement();
    std::cout << scene << ": " << measurement.pattern.resting << " of "
              << measurement.pattern.compared << " rest, in " << measurement.pattern.cells
              << " parts\n";
    EXPECT_TRUE(measurement.pattern.isThere()) << scene;
  }
}

TEST(SequenceCheck, CountsImagesThatComeAgain) {
  const LateCamera camera("indoor", 0.0);
  struct Case {
    bool left;
    bool right;
  };
  for (const auto& [left, right] :
       {Case{false, false}, {true, false}, {false, true}, {true, true}}) {
    SequenceCheck check;
    for (int i = 0; i < 10; ++i) {
      StereoImages pair = camera.pair(i);
      if (left && i % 4 == 3) pair.left = camera.pair(i - 1).left;
      if (right && i % 4 == 3) pair.right = camera.pair(i - 1).right;
      check.add(pair);
    }
    EXPECT_EQ(check.measurement().pairs, 10);
    EXPECT_EQ(check.measurement().repeated_left, left ? 2 : 0);
    EXPECT_EQ(check.measurement().repeated_right, right ? 2 : 0);
  }
}

/// A pair with one repeated image is left out, and the next one compared with the pair before it.
TEST(SequenceCheck, ARepeatedImageIsComparedWithTheLastPairThatCounts) {
  const LateCamera camera("indoor", 0.0);
  SequenceCheck check;
  check.add(camera.pair(0));
  for (const int i : {1, 2}) {
    StereoImages pair = camera.pair(i);
    pair.left = camera.pair(0).left;
    pair.right = camera.pair(1).right;
    check.add(pair);
  }
  EXPECT_EQ(check.measurement().frames, 1);
  EXPECT_EQ(check.measurement().repeated_left, 2);
  EXPECT_EQ(check.measurement().repeated_right, 0);
  StereoImages pair = camera.pair(3);
  pair.right = camera.pair(1).right;
  check.add(pair);
  EXPECT_EQ(check.measurement().frames, 2) << "the pair that had it was left out";
}

TEST(SequenceCheck, CountsFramesThatAreStampedWhenTheyArrive) {
  const LateCamera camera("indoor", 0.0);
  for (const bool late : {false, true}) {
    SequenceCheck check;
    for (int i = 0; i < 13; ++i) {
      StereoImages pair = camera.pair(i);
      if (late && i % 4 == 2) pair.stamp_ns += 45000000;  // of 50 ms
      check.add(pair);
    }
    const SequenceMeasurement measurement = check.measurement();
    EXPECT_EQ(measurement.bursts, late ? 3 : 0);
    EXPECT_EQ(measurement.hasArrivalStamps(), late);
  }
}

TEST(SequenceCheck, TakesDroppedFramesAndAPauseForNoArrival) {
  const LateCamera camera("indoor", 0.0);
  SequenceCheck check;
  for (const int i : {0, 2, 3, 5, 6, 7, 10, 11, 13, 14, 16}) {
    StereoImages pair = camera.pair(i);
    if (i > 10) pair.stamp_ns += 10000000000;
    check.add(pair);
  }
  EXPECT_EQ(check.measurement().bursts, 0);
}

/// Without noise it repeats itself.
TEST(SequenceCheck, CountsNoImagesOfASimulatedCameraThatStands) {
  const LateCamera camera("indoor", 0.0);
  SequenceCheck check;
  for (int i = 0; i < 10; ++i) {
    StereoImages pair = camera.pair(0);
    pair.stamp_ns += i * 50000000LL;
    check.add(pair);
  }
  EXPECT_EQ(check.measurement().repeated_left, 0);
  EXPECT_EQ(check.measurement().repeated_right, 0);
}

TEST(SequenceCheck, IsInterruptedByImagesItCannotUse) {
  const LateCamera camera("indoor", 0.0);
  SequenceCheck check;
  EXPECT_EQ(check.measurement().frames, 0);
  check.add({});
  const StereoImages pair = camera.pair(0);
  check.add(pair);
  check.add(pair);  // the same stamp
  StereoImages other = camera.pair(1);
  other.right = cv::Mat(10, 10, CV_8UC1, cv::Scalar(0));
  check.add(other);
  StereoImages colour = camera.pair(2);
  cv::cvtColor(colour.left, colour.left, cv::COLOR_GRAY2BGR);
  check.add(colour);
  check.add(camera.pair(3));
  const SequenceMeasurement measurement = check.measurement();
  EXPECT_EQ(measurement.frames, 3);
  EXPECT_FALSE(measurement.delay_s);
  EXPECT_EQ(measurement.pattern.compared, 0);
  EXPECT_EQ(measurement.speed_px_s, 0.0);
}

}  // namespace
}  // namespace point_line_odometry
