
#include <gtest/gtest.h>
#include <sys/resource.h>

#include <exception>
#include <fstream>
#include <functional>

#include "features/features.h"
#include "matching/appearance_matcher.h"
#include "matching/expected_features.h"
#include "matching/frame_matcher.h"
#include "matching/index_pair.h"
#include "matching/line_matcher.h"
#include "matching/point_matcher.h"
#include "matching/stereo_frame.h"
#include "point_line_odometry/parameters.h"
#include "point_line_odometry/stereo_correction.h"
#include "point_line_odometry/types.h"
#include "synthetic_scene.h"

namespace point_line_odometry {
namespace {

using Eigen::Isometry3d;
using Eigen::Vector2d;
using Eigen::Vector3d;

void expectOnly(const std::vector<IndexPair>& pairs, int first, int second) {
  ASSERT_EQ(pairs.size(), 1U);
  EXPECT_EQ(pairs[0].first, first);
  EXPECT_EQ(pairs[0].second, second);
}

/// Points and lines in space with descriptors, observed in two stereo frames. In the second frame
/// their order is reversed.
class TwoFrames {
 public:
  TwoFrames(int points, int lines, const Isometry3d& T_curr_prev, unsigned seed) {
    synthetic::Random random(seed);
    const Eigen::AlignedBox2d image(Vector2d::Zero(), Vector2d(camera.width, camera.height));
    Vector3d p;
    Vector2d seen;
    for (int i = 0; i < points; ++i) {
      do {  // features that leave the image are not searched for
        p = synthetic::visiblePoint(camera, &random);
        seen = camera.projectLeft(T_curr_prev * p);
      } while (!image.contains(seen));
      points_.push_back(p);
      point_descriptors_.push_back(synthetic::randomDescriptor(&random));
    }
    for (int i = 0; i < lines; ++i) {
      const Vector3d start = synthetic::visiblePoint(camera, &random);
      const double side = random.uniform(-0.4, 0.4);
      starts_.push_back(start);
      ends_.push_back(start + 0.1 * start.z() * Vector3d(side, i % 2 == 0 ? 2.0 : -2.0, 0.1));
      line_descriptors_.push_back(synthetic::randomDescriptor(&random));
    }
    prev = frame(Isometry3d::Identity(), false);
    curr = frame(T_curr_prev, true);
  }

  std::vector<IndexPair> points(const MotionPrediction& prediction) const {
    return matchPointsCircular(prev, curr, camera, prediction, parameters);
  }
  std::vector<IndexPair> lines(const MotionPrediction& prediction) const {
    return matchLinesCircular(prev, curr, camera, prediction, parameters);
  }

  const StereoCamera camera = synthetic::camera();
  MatchingParameters parameters;
  StereoFrame prev;
  StereoFrame curr;

 private:
  StereoFrame frame(const Isometry3d& T, bool reversed) const {
    StereoFrame frame;
    for (std::size_t k = 0; k < points_.size(); ++k) {
      const std::size_t i = reversed ? points_.size() - 1 - k : k;
      const Vector3d p = T * points_[i];
      Keypoint feature;
      feature.descriptor = point_descriptors_[i];
      feature.pixel = camera.projectLeft(p).cast<float>();
      frame.features.points_left.push_back(feature);
      feature.pixel = camera.projectRight(p).cast<float>();
      frame.features.points_right.push_back(feature);
      StereoPoint point;
      point.left = point.right = static_cast<int>(k);
      point.triangulated.p_camera = p;
      frame.points.push_back(point);
    }
    for (std::size_t k = 0; k < starts_.size(); ++k) {
      const std::size_t i = reversed ? starts_.size() - 1 - k : k;
      const Vector3d a = T * starts_[i];
      const Vector3d b = T * ends_[i];
      frame.features.lines_left.push_back(
          {{camera.projectLeft(a).cast<float>(), camera.projectLeft(b).cast<float>()},
           line_descriptors_[i]});
      frame.features.lines_right.push_back(
          {{camera.projectRight(a).cast<float>(), camera.projectRight(b).cast<float>()},
           line_descriptors_[i]});
      frame.lines.push_back(
          {static_cast<int>(k), static_cast<int>(k), TriangulatedLine{a, b, Matrix6d::Zero()}});
    }
    return frame;
  }

  std::vector<Vector3d> points_, starts_, ends_;
  std::vector<Descriptor> point_descriptors_, line_descriptors_;
};

void expectReversed(const std::vector<IndexPair>& pairs, int count) {
  ASSERT_EQ(pairs.size(), static_cast<std::size_t>(count));
  for (const IndexPair& pair : pairs) EXPECT_EQ(pair.second, count - 1 - pair.first);
}

// --- Points within a frame

/// Left and right points by pixel; descriptors `bits` apart from a common one.
struct Seen {
  Vector2d pixel;
  int bits;
};

std::vector<IndexPair> stereoPairsOf(const std::vector<Keypoint>& left,
                                     const std::vector<Keypoint>& right,
                                     const MatchingParameters& parameters = {}) {
  ThreadPool threads(2);
  return matchPointsStereo(left, right, parameters, &threads);
}

std::vector<IndexPair> stereoPairs(const std::vector<Seen>& left, const std::vector<Seen>& right,
                                   const MatchingParameters& parameters = {}) {
  synthetic::Random random(1);
  const Descriptor common = synthetic::randomDescriptor(&random);
  const auto features = [&](const std::vector<Seen>& all) {
    std::vector<Keypoint> features(all.size());
    for (std::size_t i = 0; i < all.size(); ++i) {
      features[i].pixel = all[i].pixel.cast<float>();
      features[i].descriptor = synthetic::flipped(common, all[i].bits);
    }
    return features;
  };
  return stereoPairsOf(features(left), features(right), parameters);
}

TEST(MatchPointsStereo, UniqueDescriptorsMatchCompletely) {
  const TwoFrames scene(120, 0, Isometry3d::Identity(), 1);
  const auto& right = scene.curr.features.points_right;  // reversed
  expectReversed(stereoPairsOf(scene.prev.features.points_left, right), 120);
}

TEST(MatchPointsStereo, DistractorsChangeNothing) {
  synthetic::Random random(3);
  const TwoFrames scene(80, 0, Isometry3d::Identity(), 2);
  std::vector<Keypoint> left = scene.prev.features.points_left;
  std::vector<Keypoint> right = scene.curr.features.points_right;
  for (int i = 0; i < 400; ++i) {
    Keypoint other;
    other.pixel = {static_cast<float>(random.uniform(0.0, 640.0)),
                   static_cast<float>(random.uniform(0.0, 480.0))};
    other.descriptor = synthetic::randomDescriptor(&random);
    (i % 2 == 0 ? left : right).push_back(other);
  }
  const std::vector<IndexPair> pairs = stereoPairsOf(left, right);
  for (const IndexPair& pair : pairs) EXPECT_EQ(pair.second, 79 - pair.first);
  EXPECT_EQ(pairs.size(), 80U);
}

TEST(MatchPointsStereo, IsLimitedToTheEpipolarWindow) {
  MatchingParameters parameters;
  parameters.max_disparity_px = 50.0;
  parameters.max_row_difference_px = 1.5;
  const auto matched = [&](double disparity, double row) {
    return !stereoPairs({{{200.0, 100.0}, 0}}, {{{200.0 - disparity, 100.0 + row}, 0}}, parameters)
                .empty();
  };
  EXPECT_TRUE(matched(-0.9, 0.0));  // at infinity, rounded to whole pixels
  EXPECT_FALSE(matched(-1.1, 0.0));
  EXPECT_TRUE(matched(49.9, 0.0));
  EXPECT_FALSE(matched(50.1, 0.0));
  EXPECT_FALSE(matched(-20.0, 0.0));
  EXPECT_TRUE(matched(20.0, 1.4));
  EXPECT_TRUE(matched(20.0, -1.4));
  EXPECT_FALSE(matched(20.0, 1.6));
  EXPECT_FALSE(matched(20.0, -1.6));
}

TEST(MatchPointsStereo, APointAtInfinityIsNotMatchedWithASimilarOne) {
  const std::vector<Seen> left{{{200.0, 100.0}, 0}};
  const std::vector<Seen> alike{{{120.0, 100.0}, 0}};
  const std::vector<Seen> both{{{200.0, 100.0}, 0}, {{120.0, 100.0}, 0}};
  EXPECT_EQ(stereoPairs(left, alike, MatchingParameters()).size(), 1U);
  EXPECT_TRUE(stereoPairs(left, both, MatchingParameters()).empty());
}

TEST(MatchPointsStereo, DescriptorsDecide) {
  MatchingParameters parameters;
  parameters.max_point_distance = 60;
  parameters.max_distance_ratio = 0.8;
  const std::vector<Seen> left{{{200.0, 100.0}, 0}};
  EXPECT_EQ(stereoPairs(left, {{{180.0, 100.0}, 60}}, parameters).size(), 1U);
  EXPECT_TRUE(stereoPairs(left, {{{180.0, 100.0}, 61}}, parameters).empty());
  EXPECT_TRUE(stereoPairs(left, {{{180.0, 100.0}, 40}, {{150.0, 100.0}, 49}}, parameters).empty());
  expectOnly(stereoPairs(left, {{{180.0, 100.0}, 52}, {{150.0, 100.0}, 40}}, parameters), 0, 1);
}

TEST(MatchPointsStereo, IdenticalRivalsAreAmbiguous) {
  EXPECT_TRUE(
      stereoPairs({{{200.0, 100.0}, 0}}, {{{180.0, 100.0}, 0}, {{150.0, 100.0}, 0}}).empty());
}

TEST(MatchPointsStereo, OfTwoWithTheSameNearestTheNearerIsMatched) {
  expectOnly(stereoPairs({{{200.0, 100.0}, 20}, {{230.0, 100.0}, 0}}, {{{180.0, 100.0}, 1}}), 1, 0);
}

TEST(MatchStereo, NoFeaturesGiveNoMatches) {
  EXPECT_TRUE(stereoPairs({{{200.0, 100.0}, 0}}, {}).empty());
  EXPECT_TRUE(matchLinesStereo({LineFeature{}}, {}, {}).empty());
}

// --- Points around the circle

TEST(MatchPointsCircular, UniqueDescriptorsMatchCompletely) {
  const TwoFrames scene(150, 0, synthetic::motion(), 4);
  expectReversed(scene.points({synthetic::motion(), 2.0}), 150);
  expectReversed(scene.points({Isometry3d::Identity(), 120.0}), 150);
}

TEST(MatchPointsCircular, SearchesOnlyNearThePrediction) {
  const Isometry3d turn = synthetic::transform({0.0, -0.06, 0.0}, Vector3d::Zero());
  const TwoFrames scene(60, 0, turn, 5);
  EXPECT_TRUE(scene.points({Isometry3d::Identity(), 25.0}).empty());  // the motion is some 40 px
  expectReversed(scene.points({turn, 1.0}), 60);
}

TEST(MatchPointsCircular, PredictionResolvesIdenticalDescriptors) {
  TwoFrames scene(2, 0, synthetic::motion(), 6);
  for (StereoFrame* frame : {&scene.prev, &scene.curr}) {
    for (auto* points : {&frame->features.points_left, &frame->features.points_right}) {
      // Identical to each other, with one bit flipped in the next frame.
      (*points)[0].descriptor = (*points)[1].descriptor = {1, 2, 3, frame == &scene.prev ? 4U : 5U};
    }
  }
  EXPECT_TRUE(scene.points({synthetic::motion(), 900.0}).empty());
  expectReversed(scene.points({synthetic::motion(), 2.0}), 2);
}

TEST(MatchPointsCircular, RejectsACircleThatDoesNotClose) {
  TwoFrames scene(60, 0, synthetic::motion(), 7);
  // Frame k's stereo pairs 10 and 20 are swapped: right and left are of different points.
  std::swap(scene.curr.points[10].left, scene.curr.points[20].left);
  const std::vector<IndexPair> pairs = scene.points({synthetic::motion(), 700.0});
  EXPECT_EQ(pairs.size(), 58U);
  for (const IndexPair& pair : pairs) EXPECT_TRUE(pair.second != 10 && pair.second != 20);
}

TEST(MatchPointsCircular, BehindTheCameraIsLeftOut) {
  TwoFrames scene(30, 0, Isometry3d::Identity(), 8);
  EXPECT_TRUE(
      scene.points({synthetic::transform({0.0, M_PI, 0.0}, Vector3d::Zero()), 1000.0}).empty());
  scene.prev.points[4].triangulated.p_camera.z() = -5.0;
  EXPECT_EQ(scene.points({Isometry3d::Identity(), 5.0}).size(), 29U);
}

TEST(MatchCircular, NoFeaturesGiveNoMatches) {
  const TwoFrames scene(20, 10, synthetic::motion(), 9);
  const StereoFrame empty;
  const MotionPrediction prediction{synthetic::motion(), 25.0};
  const auto count = [&](const StereoFrame& prev, const StereoFrame& curr) {
    const CircularMatches matches =
        matchCircular(prev, curr, scene.camera, prediction, scene.parameters);
    return matches.points.size() + matches.lines.size();
  };
  EXPECT_EQ(count(empty, empty), 0U);
  EXPECT_EQ(count(scene.prev, empty), 0U);
  EXPECT_EQ(count(empty, scene.curr), 0U);
  EXPECT_EQ(count(scene.prev, scene.curr), 30U);
}

/// Runs a task with limited memory; false if it needs more.
bool isFrugal(const std::function<void()>& work) {
  rlimit old{};
  getrlimit(RLIMIT_AS, &old);
  long pages = 0;
  std::ifstream("/proc/self/statm") >> pages;
  rlimit limited = old;
  limited.rlim_cur = static_cast<rlim_t>(pages) * 4096 + (rlim_t{200} << 20);
  setrlimit(RLIMIT_AS, &limited);
  bool frugal = true;
  try {
    work();
  } catch (const std::exception&) {
    frugal = false;
  }
  setrlimit(RLIMIT_AS, &old);
  return frugal;
}

TEST(MatchCircular, PredictionOutsideTheImageNeedsNoHugeMemory) {
  // A point just in front of the camera's plane is predicted a million pixels away.
  TwoFrames scene(30, 30, Isometry3d::Identity(), 10);
  const Vector3d aside(60.0, 20.0, 0.11 * scene.camera.baseline_m);
  scene.prev.points[3].triangulated.p_camera = aside;
  std::size_t points = 0;
  EXPECT_TRUE(isFrugal([&] { points = scene.points({Isometry3d::Identity(), 5.0}).size(); }));
  EXPECT_EQ(points, 29U);
  scene.prev.lines[3].triangulated->end_camera = aside;
  std::size_t lines = 0;
  EXPECT_TRUE(isFrugal([&] { lines = scene.lines({Isometry3d::Identity(), 5.0}).size(); }));
  EXPECT_EQ(lines, 29U);
}

// --- Points by their appearance alone

TEST(MatchPointsByAppearance, FindsThemAnywhereInTheImage) {
  // Rotation by 180 degrees about the optical axis and a step forward: the image is upside down.
  const Isometry3d turn = synthetic::transform({0.0, 0.0, M_PI}, {0.3, -0.2, -0.8});
  const TwoFrames scene(200, 0, turn, 17);
  expectReversed(matchByAppearance(stereoDescriptors(scene.prev), stereoDescriptors(scene.curr),
                                   scene.parameters),
                 200);
}

TEST(MatchPointsByAppearance, PairsAreOfStereoPoints) {
  TwoFrames scene(3, 0, synthetic::motion(), 18);
  // The features of a stereo point have other indices than the point.
  std::swap(scene.curr.points[0], scene.curr.points[1]);
  scene.prev.points.erase(scene.prev.points.begin());
  const std::vector<IndexPair> pairs = matchByAppearance(
      stereoDescriptors(scene.prev), stereoDescriptors(scene.curr), scene.parameters);
  ASSERT_EQ(pairs.size(), 2U);
  EXPECT_TRUE(pairs[0].first == 0 && pairs[0].second == 0);  // both at feature 1
  EXPECT_TRUE(pairs[1].first == 1 && pairs[1].second == 1);
}

/// Stereo points whose descriptors differ from a common one in some bits in either image.
struct Appearance {
  int left_bits;
  int right_bits;
};

std::vector<IndexPair> pairsByAppearance(const std::vector<Appearance>& known,
                                         const std::vector<Appearance>& seen,
                                         const MatchingParameters& parameters = {}) {
  synthetic::Random random(1);
  const Descriptor left = synthetic::randomDescriptor(&random);
  const Descriptor right = synthetic::randomDescriptor(&random);
  const auto frameOf = [&](const std::vector<Appearance>& appearances) {
    StereoFrame frame;
    for (const Appearance& appearance : appearances) {
      const auto index = static_cast<int>(frame.points.size());
      Keypoint feature;
      feature.descriptor = synthetic::flipped(left, appearance.left_bits);
      frame.features.points_left.push_back(feature);
      feature.descriptor = synthetic::flipped(right, appearance.right_bits);
      frame.features.points_right.push_back(feature);
      StereoPoint point;
      point.left = point.right = index;
      frame.points.push_back(point);
    }
    return frame;
  };
  return matchByAppearance(stereoDescriptors(frameOf(known)), stereoDescriptors(frameOf(seen)),
                           parameters);
}

TEST(MatchPointsByAppearance, DistancesOfBothImagesAreAdded) {
  MatchingParameters parameters;
  parameters.max_point_distance = 60;
  EXPECT_EQ(pairsByAppearance({{0, 0}}, {{60, 60}}, parameters).size(), 1U);
  EXPECT_EQ(pairsByAppearance({{0, 0}}, {{0, 120}}, parameters).size(), 1U);
  EXPECT_TRUE(pairsByAppearance({{0, 0}}, {{61, 60}}, parameters).empty());
  EXPECT_TRUE(pairsByAppearance({{0, 0}}, {{0, 121}}, parameters).empty());
  // The left image cannot decide, the right one can.
  expectOnly(pairsByAppearance({{0, 0}}, {{10, 40}, {10, 5}}, parameters), 0, 1);
}

TEST(MatchPointsByAppearance, LeavesOutAmbiguousOnes) {
  EXPECT_TRUE(pairsByAppearance({{0, 0}}, {{5, 5}, {5, 5}}).empty());
  EXPECT_TRUE(pairsByAppearance({{0, 0}}, {{0, 0}, {0, 0}}).empty());
  MatchingParameters parameters;
  parameters.max_distance_ratio = 0.8;
  EXPECT_TRUE(pairsByAppearance({{0, 0}}, {{20, 20}, {24, 25}}, parameters).empty());
  expectOnly(pairsByAppearance({{0, 0}}, {{20, 20}, {25, 26}}, parameters), 0, 0);
}

TEST(MatchPointsByAppearance, OfTwoWithTheSameNearestTheNearerIsMatched) {
  expectOnly(pairsByAppearance({{20, 0}, {0, 0}}, {{1, 0}}), 1, 0);
  expectOnly(pairsByAppearance({{0, 0}, {20, 0}}, {{1, 0}}), 0, 0);
}

TEST(MatchPointsByAppearance, NoFeaturesGiveNoMatches) {
  EXPECT_TRUE(pairsByAppearance({}, {}).empty());
  EXPECT_TRUE(pairsByAppearance({{0, 0}}, {}).empty());
  EXPECT_TRUE(pairsByAppearance({}, {{0, 0}}).empty());
  EXPECT_TRUE(stereoDescriptors(StereoFrame{}).empty());
}

/// A right image that is displaced by more rows than matches may differ.
TEST(MatchStereo, SearchesOnCorrectedRows) {
  const TwoFrames scene(40, 30, Isometry3d::Identity(), 12);
  StereoCorrection error(scene.camera);
  error.v(0) = 4.0;
  error.v(1) = 6.0;
  DetectedFeatures seen = scene.prev.features;
  const auto displace = [&](Eigen::Vector2f* right_px) {
    right_px->y() += static_cast<float>(error.v.dot(error.terms(right_px->cast<double>())));
  };
  for (Keypoint& point : seen.points_right) displace(&point.pixel);
  for (LineFeature& line : seen.lines_right) {
    displace(&line.segment.start);
    displace(&line.segment.end);
  }
  ThreadPool threads(2);
  const StereoMatches matches = matchStereo(seen, error, {}, &threads);
  EXPECT_EQ(matches.points.size(), 40U);
  for (const IndexPair& pair : matches.points) EXPECT_EQ(pair.first, pair.second);
  EXPECT_GE(matches.lines.size(), 25U);
  for (const IndexPair& pair : matches.lines) EXPECT_EQ(pair.first, pair.second);
  EXPECT_LT(matchStereo(seen, StereoCorrection(scene.camera), {}, &threads).points.size(), 25U);
}

// --- Lines within a frame

LineFeature line(const Vector2d& start, const Vector2d& end, int bits = 0) {
  synthetic::Random random(1);
  return {{start.cast<float>(), end.cast<float>()},
          synthetic::flipped(synthetic::randomDescriptor(&random), bits)};
}

const LineFeature kUpright = line({300.0, 100.0}, {310.0, 200.0});

bool pairs(const LineFeature& right, const MatchingParameters& parameters = {}) {
  return matchLinesStereo({kUpright}, {right}, parameters).size() == 1;
}

TEST(MatchLinesStereo, UniqueDescriptorsMatchCompletely) {
  const TwoFrames scene(0, 60, Isometry3d::Identity(), 11);
  expectReversed(
      matchLinesStereo(scene.prev.features.lines_left, scene.curr.features.lines_right, {}), 60);
}

TEST(MatchLinesStereo, AppearanceAndGeometryConstrain) {
  MatchingParameters parameters;
  parameters.max_disparity_px = 100.0;
  EXPECT_TRUE(pairs(line({280.0, 100.0}, {290.0, 200.0}), parameters));
  EXPECT_FALSE(pairs(line({290.0, 200.0}, {280.0, 100.0}), parameters)) << "opposite direction";
  EXPECT_FALSE(pairs(line({280.0, 100.0}, {320.0, 200.0}), parameters)) << "another direction";
  EXPECT_TRUE(pairs(line({280.0, 100.0}, {285.2, 152.0}), parameters));
  EXPECT_FALSE(pairs(line({280.0, 100.0}, {284.8, 148.0}), parameters)) << "another length";
  EXPECT_TRUE(pairs(line({284.0, 140.0}, {294.0, 240.0}), parameters));
  EXPECT_FALSE(pairs(line({286.0, 160.0}, {296.0, 260.0}), parameters)) << "few common rows";
  EXPECT_FALSE(pairs(line({300.0, 300.0}, {310.0, 400.0}), parameters)) << "no common row";
  EXPECT_FALSE(pairs(line({20.0, 100.0}, {30.0, 200.0}), parameters)) << "too large a disparity";
  EXPECT_FALSE(pairs(line({500.0, 100.0}, {510.0, 200.0}), parameters)) << "behind infinity";
}

TEST(MatchLinesStereo, DescriptorsDecide) {
  MatchingParameters parameters;
  parameters.max_line_distance = 50;
  EXPECT_TRUE(pairs(line({280.0, 100.0}, {290.0, 200.0}, 50), parameters));
  EXPECT_FALSE(pairs(line({280.0, 100.0}, {290.0, 200.0}, 51), parameters));
  parameters.max_distance_ratio = 0.8;
  const std::vector<LineFeature> rivals{line({280.0, 100.0}, {290.0, 200.0}, 30),
                                        line({260.0, 100.0}, {270.0, 200.0}, 33)};
  EXPECT_TRUE(matchLinesStereo({kUpright}, rivals, parameters).empty());
}

TEST(MatchLinesStereo, IdenticalRivalsAreAmbiguous) {
  const std::vector<LineFeature> rivals{line({280.0, 100.0}, {290.0, 200.0}),
                                        line({260.0, 100.0}, {270.0, 200.0})};
  EXPECT_TRUE(matchLinesStereo({kUpright}, rivals, {}).empty());
}

TEST(MatchLinesStereo, PiecesOfOneEdgeAreNoRivals) {
  const std::vector<LineFeature> pieces{line({280.0, 100.0}, {286.0, 160.0}, 30),
                                        line({284.0, 140.0}, {290.0, 200.0}, 31)};
  expectOnly(matchLinesStereo({kUpright}, pieces, {}), 0, 0);
}

TEST(MatchLinesStereo, HorizontalLinesNeedTheSameRow) {
  const LineFeature level = line({300.0, 100.0}, {400.0, 100.5});
  const auto matched = [&](double row) {
    return matchLinesStereo({level}, {line({280.0, row}, {380.0, row + 0.5})}, {}).size() == 1;
  };
  EXPECT_TRUE(matched(100.0));
  EXPECT_TRUE(matched(101.5));
  EXPECT_FALSE(matched(103.0));
}

// --- Lines around the circle

TEST(MatchLinesCircular, UniqueDescriptorsMatchCompletely) {
  const TwoFrames scene(0, 50, synthetic::motion(), 12);
  expectReversed(scene.lines({synthetic::motion(), 2.0}), 50);
  expectReversed(scene.lines({Isometry3d::Identity(), 120.0}), 50);
}

TEST(MatchLinesCircular, SearchesOnlyNearThePrediction) {
  const Isometry3d turn = synthetic::transform({0.0, -0.06, 0.0}, Vector3d::Zero());
  const TwoFrames scene(0, 40, turn, 13);
  EXPECT_TRUE(scene.lines({Isometry3d::Identity(), 25.0}).empty());
  expectReversed(scene.lines({turn, 1.0}), 40);
}

TEST(MatchLinesCircular, RejectsACircleThatDoesNotClose) {
  TwoFrames scene(0, 40, synthetic::motion(), 14);
  std::swap(scene.curr.lines[10].left, scene.curr.lines[20].left);
  const std::vector<IndexPair> found = scene.lines({synthetic::motion(), 700.0});
  EXPECT_EQ(found.size(), 38U);
  for (const IndexPair& pair : found) EXPECT_TRUE(pair.second != 10 && pair.second != 20);
}

TEST(MatchLinesCircular, NeedsATriangulatedLine) {
  TwoFrames scene(0, 20, synthetic::motion(), 15);
  scene.prev.lines[5].triangulated.reset();
  scene.prev.lines[6].triangulated->start_camera.z() = -2.0;
  scene.curr.lines[0].triangulated.reset();  // of frame k only pixels count
  const std::vector<IndexPair> found = scene.lines({synthetic::motion(), 5.0});
  EXPECT_EQ(found.size(), 18U);
  for (const IndexPair& pair : found) EXPECT_TRUE(pair.first != 5 && pair.first != 6);
}

TEST(MatchLinesCircular, SwappedDirectionIsAnotherEdge) {
  TwoFrames scene(0, 20, synthetic::motion(), 16);
  LineSegment& segment = scene.curr.features.lines_left[7].segment;
  std::swap(segment.start, segment.end);
  EXPECT_EQ(scene.lines({synthetic::motion(), 5.0}).size(), 19U);
}

}  // namespace
}  // namespace point_line_odometry
