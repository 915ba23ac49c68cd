#include "ros/mask_buffer.h"

#include <gtest/gtest.h>

#include <boost/make_shared.hpp>

#include "ros/camera_messages.h"
#include "ros/rim_agreement.h"

namespace point_line_odometry {
namespace {

sensor_msgs::ImagePtr imageAt(double stamp_s) {
  return toImageMessage(cv::Mat(4, 6, CV_8UC1, cv::Scalar(1)),
                        makeHeader("camera", ros::Time(stamp_s)));
}

/// Its right image is 5 ms later, as with approximate_sync.
StereoMessages pairAt(double stamp_s) {
  StereoMessages messages;
  messages.left = imageAt(stamp_s);
  messages.right = imageAt(stamp_s + 0.005);
  return messages;
}

NodeParameters parametersFor(const std::string& mask_images) {
  NodeParameters parameters;
  parameters.mask_images = mask_images;
  parameters.mask_wait_s = 0.2;
  return parameters;
}

TEST(MaskBuffer, APairWaitsForTheMasksOfItsImagesOnly) {
  MaskBuffer buffer(parametersFor("both"));
  EXPECT_FALSE(buffer.isReady(pairAt(10.0), 0.0));
  buffer.add(0, imageAt(10.0));
  buffer.add(1, imageAt(10.0));  // not the right image's stamp
  EXPECT_FALSE(buffer.isReady(pairAt(10.0), 0.1));
  const auto mask = imageAt(10.005);
  buffer.add(1, mask);
  EXPECT_TRUE(buffer.isReady(pairAt(10.0), 0.0));
  EXPECT_FALSE(buffer.isReady(pairAt(10.1), 0.0));
  EXPECT_EQ(buffer.withMasks(pairAt(10.0)).right_mask, mask);
  EXPECT_EQ(buffer.withMasks(pairAt(10.1)).left_mask, nullptr);
  EXPECT_FALSE(buffer.isReady(pairAt(10.0), 0.0)) << "masks are kept that nobody needs any more";
}

TEST(MaskBuffer, TheWaitIsBounded) {
  MaskBuffer buffer(parametersFor("both"));
  buffer.add(0, imageAt(10.0));
  EXPECT_FALSE(buffer.isReady(pairAt(10.0), 0.19));
  EXPECT_TRUE(buffer.isReady(pairAt(10.0), 0.2));
  const StereoMessages messages = buffer.withMasks(pairAt(10.0));
  EXPECT_NE(messages.left_mask, nullptr);
  EXPECT_EQ(messages.right_mask, nullptr);
}

TEST(MaskBuffer, OnlyTheCamerasThatHaveMasksAreWaitedFor) {
  EXPECT_TRUE(MaskBuffer(parametersFor("none")).isReady(pairAt(1.0), 0.0));
  MaskBuffer buffer(parametersFor("right"));
  EXPECT_FALSE(buffer.isReady(pairAt(1.0), 0.0));
  buffer.add(0, imageAt(1.0));
  buffer.add(1, imageAt(1.005));
  EXPECT_TRUE(buffer.isReady(pairAt(1.0), 0.0));
  EXPECT_EQ(buffer.withMasks(pairAt(1.0)).left_mask, nullptr);
}

TEST(MaskBuffer, KeepsABoundedNumberAndTheLatestOfEqualStamps) {
  MaskBuffer buffer(parametersFor("left"));
  const std::size_t capacity = MaskBuffer::capacity(parametersFor("left"));
  for (std::size_t i = 0; i <= capacity; ++i)
    buffer.add(0, imageAt(1.0 + 0.25 * static_cast<double>(i)));
  EXPECT_FALSE(buffer.isReady(pairAt(1.0), 0.0));
  buffer.add(0, imageAt(1.0));
  const auto again = imageAt(1.0);
  buffer.add(0, again);
  EXPECT_EQ(buffer.withMasks(pairAt(1.0)).left_mask, again);
  EXPECT_TRUE(buffer.isReady(pairAt(3.0), 0.0)) << "a newer mask is lost";
}

// --- Agreement near the rim

FrameResult resultWith(double share_near, double share_elsewhere) {
  FrameResult result;
  const auto add = [&](float x, double share) {
    for (int i = 0; i < 50; ++i) {
      ObservedPoint point;
      point.left_px = {x, static_cast<float>(i)};
      point.inlier = i < 50 * share;
      result.points.push_back(point);
    }
  };
  add(205.0F, share_near);  // the rim is 20 px wide
  add(350.0F, share_elsewhere);
  return result;
}

TEST(RimAgreement, SeesThatFewerPointsAgreeNearTheRim) {
  cv::Mat mask(100, 400, CV_8UC1, cv::Scalar(255));
  mask.colRange(0, 200) = cv::Scalar(0);
  RimAgreement good;
  RimAgreement bad;
  RimAgreement all_bad;
  EXPECT_FALSE(bad.isWorseNearRim().has_value());
  for (int i = 0; i < 5; ++i) {
    good.add(resultWith(0.9, 0.95), mask);
    bad.add(resultWith(0.6, 0.95), mask);
    all_bad.add(resultWith(0.5, 0.5), mask);
  }
  EXPECT_EQ(good.isWorseNearRim(), false);
  EXPECT_EQ(bad.isWorseNearRim(), true);
  EXPECT_EQ(all_bad.isWorseNearRim(), false);
  EXPECT_NEAR(bad.near().agreeing(), 0.6, 1e-9);
  RimAgreement none;
  none.add(resultWith(0.1, 0.9), cv::Mat());
  EXPECT_EQ(none.near().points, 0.0);
}

}  // namespace
}  // namespace point_line_odometry
