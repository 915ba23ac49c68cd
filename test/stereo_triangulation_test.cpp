#include "odometry/stereo_triangulation.h"

#include <gtest/gtest.h>

#include <algorithm>

#include "common/thread_pool.h"
#include "features/stereo_feature_detector.h"
#include "matching/frame_matcher.h"
#include "motion/frame_context.h"
#include "point_line_odometry/parameters.h"
#include "point_line_odometry/stereo_correction.h"
#include "synthetic_scene.h"

namespace point_line_odometry {
namespace {

/// A frame of the room, located with a correction of the right image.
StereoFrame frameWith(const FrameContext& context) {
  StereoFeatureDetector detector(context.parameters.points, context.parameters.lines);
  ThreadPool threads(1);
  StereoFrame frame;
  frame.left_image = context.left;
  frame.features = detector.detect(context.images, LineResolution::kFull, &threads);
  triangulateMatches(
      matchStereo(frame.features, context.correction, context.parameters.matching, &threads),
      context, &threads, &frame);
  return frame;
}

TEST(TriangulateAgain, LocatesAsAtFirstWithTheSameCorrection) {
  const StereoImages images = synthetic::drive(0);
  const StereoCamera camera = synthetic::roomCamera();
  const Parameters parameters = synthetic::roomParameters();
  const FrameContext calibrated{images, camera, StereoCorrection(camera), parameters};
  FrameContext knocked = calibrated;
  knocked.correction.u << 1.5, 0.2, 0.0, 0.5, 0.0, 0.0, 0.0;
  const StereoFrame expected = frameWith(calibrated);
  StereoFrame frame = frameWith(knocked);
  ASSERT_EQ(frame.points.size(), expected.points.size());
  ASSERT_EQ(frame.lines.size(), expected.lines.size());
  ASSERT_GT(frame.points.size(), 50U);
  const auto same_points = [&] {
    return std::equal(frame.points.begin(), frame.points.end(), expected.points.begin(),
                      [](const StereoPoint& a, const StereoPoint& b) {
                        return a.left == b.left && a.right == b.right && a.far == b.far &&
                               a.triangulated.p_camera == b.triangulated.p_camera &&
                               a.triangulated.covariance == b.triangulated.covariance;
                      });
  };
  const auto same_lines = [&] {
    return std::equal(
        frame.lines.begin(), frame.lines.end(), expected.lines.begin(),
        [](const StereoLine& a, const StereoLine& b) {
          return a.triangulated.has_value() == b.triangulated.has_value() &&
                 (!a.triangulated || a.triangulated->start_camera == b.triangulated->start_camera);
        });
  };
  EXPECT_FALSE(same_points());
  EXPECT_FALSE(same_lines());
  triangulateAgain(calibrated, &frame);
  EXPECT_TRUE(same_points());
  EXPECT_TRUE(same_lines());
}

TEST(TriangulateAgain, LeavesOutWhatIsNoStereoPointAnyMore) {
  const StereoImages images = synthetic::drive(0);
  const StereoCamera camera = synthetic::roomCamera();
  const Parameters parameters = synthetic::roomParameters();
  FrameContext context{images, camera, StereoCorrection(camera), parameters};
  StereoFrame frame = frameWith(context);
  frame.resting_points = frame.points;
  context.correction.u(0) = -500.0;  // all disparities negative
  triangulateAgain(context, &frame);
  EXPECT_TRUE(frame.points.empty());
  EXPECT_TRUE(frame.resting_points.empty());
  for (const StereoLine& line : frame.lines) EXPECT_FALSE(line.triangulated);
}

}  // namespace
}  // namespace point_line_odometry
