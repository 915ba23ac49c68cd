/// The nodelet from outside: a real master and manager, rendered stereo images with ground truth.

#include <cv_bridge/cv_bridge.h>
#include <gtest/gtest.h>
#include <nav_msgs/Odometry.h>
#include <nodelet/NodeletList.h>
#include <nodelet/NodeletLoad.h>
#include <nodelet/NodeletUnload.h>
#include <point_line_odometry/OdometryInfo.h>
#include <point_line_odometry/ResetToPose.h>
#include <ros/ros.h>
#include <sensor_msgs/CameraInfo.h>
#include <sensor_msgs/Image.h>
#include <std_srvs/Trigger.h>
#include <tf2_ros/buffer.h>
#include <tf2_ros/static_transform_broadcaster.h>
#include <tf2_ros/transform_listener.h>

#include <Eigen/Core>
#include <atomic>
#include <cmath>
#include <functional>
#include <map>
#include <opencv2/imgproc.hpp>
#include <string>
#include <thread>

namespace point_line_odometry {
namespace {

constexpr int kWidth = 480;
constexpr int kHeight = 320;
constexpr double kFocal_px = 300.0;
constexpr double kBaseline_m = 0.2;
constexpr double kFramePeriod_s = 0.05;
constexpr double kForwardStep_m = 0.05;
constexpr double kRightStep_m = 0.02;
constexpr double kTimeout_s = 10.0;

/// Two walls and a floor with a random pattern, seen by a camera that looks along z and does not
/// turn.
class Scene {
 public:
  Scene() : texture_(1024, 1024, CV_8UC1) {
    cv::Mat blocks(128, 128, CV_8UC1);
    cv::RNG random(1);
    random.fill(blocks, cv::RNG::UNIFORM, 20, 235);
    cv::resize(blocks, texture_, texture_.size(), 0, 0, cv::INTER_NEAREST);
    cv::GaussianBlur(texture_, texture_, cv::Size(3, 3), 0.7);
  }

  /// \param camera centre of the camera [m], x right, y down, z forward.
  cv::Mat render(const Eigen::Vector3d& camera) const {
    cv::Mat map(kHeight, kWidth, CV_32FC2);
    for (int v = 0; v < kHeight; ++v) {
      for (int u = 0; u < kWidth; ++u) map.at<cv::Vec2f>(v, u) = texel(camera, u, v);
    }
    cv::Mat image;
    cv::remap(texture_, image, map, cv::noArray(), cv::INTER_LINEAR, cv::BORDER_WRAP);
    return image;
  }

 private:
  static cv::Vec2f texel(const Eigen::Vector3d& camera, int u, int v) {
    constexpr double kTexels_m = 60.0;
    constexpr double kFar_m = 7.0;
    constexpr double kNear_m = 4.0;
    constexpr double kFloor_m = 1.0;
    const Eigen::Vector3d ray((u - kWidth / 2) / kFocal_px, (v - kHeight / 2) / kFocal_px, 1.0);
    const Eigen::Vector3d near_hit = camera + ray * (kNear_m - camera.z());
    Eigen::Vector3d hit =
        near_hit.x() > 0.3 ? near_hit : Eigen::Vector3d(camera + ray * (kFar_m - camera.z()));
    const bool floor = hit.y() > kFloor_m;
    if (floor) hit = camera + ray * ((kFloor_m - camera.y()) / ray.y());
    const double second = floor ? hit.z() : hit.y();
    return {static_cast<float>(kTexels_m * (hit.x() + 20.0)),
            static_cast<float>(kTexels_m * (second + 20.0))};
  }

  cv::Mat texture_;
};

bool isFinite(const nav_msgs::Odometry& odometry) {
  const auto& p = odometry.pose.pose.position;
  const auto& q = odometry.pose.pose.orientation;
  double sum = p.x + p.y + p.z + q.x + q.y + q.z + q.w + odometry.twist.twist.linear.x;
  for (const double c : odometry.pose.covariance) sum += c;
  for (const double c : odometry.twist.covariance) sum += c;
  return std::isfinite(sum);
}

class NodeletTest : public ::testing::Test {
 protected:
  NodeletTest() : nh_("stereo"), tf_listener_(tf_buffer_), spinner_(2) {
    left_ = nh_.advertise<sensor_msgs::Image>("left/image_rect", 10);
    right_ = nh_.advertise<sensor_msgs::Image>("right/image_rect", 10);
    left_info_ = nh_.advertise<sensor_msgs::CameraInfo>("left/camera_info", 10);
    right_info_ = nh_.advertise<sensor_msgs::CameraInfo>("right/camera_info", 10);
    odometry_ = nh_.subscribe("odom", 100, &NodeletTest::takeOdometry, this);
    info_ = nh_.subscribe("info", 100, &NodeletTest::takeInfo, this);
    spinner_.start();
    sendMounting("left_camera");
    stamp_ = ros::Time::now();
  }

  void TearDown() override {
    if (loaded_) {
      EXPECT_TRUE(unload());
    }
    spinner_.stop();
  }

  /// Camera 0.3 m ahead of the base and 0.1 m above it, looking forward.
  void sendMounting(const std::string& camera) {
    geometry_msgs::TransformStamped mounting;
    mounting.header.stamp = ros::Time::now();
    mounting.header.frame_id = "base_link";
    mounting.child_frame_id = camera;
    mounting.transform.translation.x = 0.3;
    mounting.transform.translation.z = 0.1;
    mounting.transform.rotation.x = -0.5;
    mounting.transform.rotation.y = 0.5;
    mounting.transform.rotation.z = -0.5;
    mounting.transform.rotation.w = 0.5;
    broadcaster_.sendTransform(mounting);
  }

  bool load() {
    nodelet::NodeletLoad service;
    service.request.name = "/stereo/odometry";
    service.request.type = "point_line_odometry/StereoOdometry";
    ros::service::waitForService("/manager/load_nodelet", ros::Duration(kTimeout_s));
    loaded_ = call("/manager/load_nodelet", &service) && service.response.success;
    const auto connected = [this] {
      return left_.getNumSubscribers() > 0 && right_.getNumSubscribers() > 0 &&
             left_info_.getNumSubscribers() > 0 && right_info_.getNumSubscribers() > 0 &&
             odometry_.getNumPublishers() > 0 && info_.getNumPublishers() > 0;
    };
    return loaded_ && waitFor(connected);
  }

  bool unload() {
    nodelet::NodeletUnload service;
    service.request.name = "/stereo/odometry";
    loaded_ = false;
    return call("/manager/unload_nodelet", &service) && service.response.success;
  }

  bool waitFor(const std::function<bool()>& condition, double timeout_s = kTimeout_s) const {
    const ros::WallTime end = ros::WallTime::now() + ros::WallDuration(timeout_s);
    while (!condition()) {
      if (ros::WallTime::now() > end) return false;
      ros::WallDuration(0.005).sleep();
    }
    return true;
  }

  sensor_msgs::Image render(const Eigen::Vector3d& camera) const {
    std_msgs::Header header;
    header.stamp = stamp_;
    header.frame_id = camera_frame_;
    return *cv_bridge::CvImage(header, "mono8", scene_.render(camera)).toImageMsg();
  }

  sensor_msgs::CameraInfo cameraInfo(double baseline_m) const {
    sensor_msgs::CameraInfo info;
    info.header.stamp = stamp_;
    info.header.frame_id = camera_frame_;
    info.width = kWidth;
    info.height = kHeight;
    info.P = {kFocal_px, 0, kWidth / 2, -kFocal_px * baseline_m, 0, kFocal_px, kHeight / 2, 0, 0,
              0,         1, 0};
    return info;
  }

  /// Publishes the k-th frame of the motion, at the next stamp; `spoil` may change the left image.
  void publishFrame(int k, const std::function<void(sensor_msgs::Image*)>& spoil = nullptr) {
    stamp_ += ros::Duration(kFramePeriod_s);
    const Eigen::Vector3d left(k * kRightStep_m, 0.0, k * kForwardStep_m);
    sensor_msgs::Image left_image = render(left);
    if (spoil) spoil(&left_image);
    left_.publish(left_image);
    right_.publish(render(left + Eigen::Vector3d(kBaseline_m, 0.0, 0.0)));
    left_info_.publish(cameraInfo(0.0));
    right_info_.publish(cameraInfo(kBaseline_m));
  }

  /// Publishes frames [begin, end), each after the odometry of the one before has come. Returns the
  /// last odometry.
  nav_msgs::Odometry drive(int begin, int end) {
    for (int k = begin; k < end; ++k) {
      publishFrame(k);
      EXPECT_TRUE(waitFor([this] { return hasOdometry(stamp_); })) << "no odometry of frame " << k;
    }
    return odometryAt(stamp_);
  }

  bool hasOdometry(const ros::Time& stamp) const {
    const std::lock_guard<std::mutex> lock(mutex_);
    return odometries_.count(stamp) > 0;
  }

  nav_msgs::Odometry odometryAt(const ros::Time& stamp) const {
    const std::lock_guard<std::mutex> lock(mutex_);
    const auto found = odometries_.find(stamp);
    return found == odometries_.end() ? nav_msgs::Odometry() : found->second;
  }

  OdometryInfo lastInfo() const {
    const std::lock_guard<std::mutex> lock(mutex_);
    return last_info_;
  }

  /// True where the answer has come. On a connection of a single call roscpp 1.15 loses some
  /// answers (3 of 8000): the server may close it before the client has read (ros_comm, issue
  /// 1976).
  template <typename Service>
  static bool call(const std::string& name, Service* service) {
    constexpr bool kPersistent = true;
    return ros::NodeHandle().serviceClient<Service>(name, kPersistent).call(*service);
  }

  static bool callTrigger(const std::string& name) {
    std_srvs::Trigger service;
    return call("/stereo/odometry/" + name, &service) && service.response.success;
  }

  static void expectPosition(const nav_msgs::Odometry& odometry, double x, double y,
                             double tolerance_m = 0.03) {
    EXPECT_NEAR(odometry.pose.pose.position.x, x, tolerance_m);
    EXPECT_NEAR(odometry.pose.pose.position.y, y, tolerance_m);
    EXPECT_NEAR(odometry.pose.pose.position.z, 0.0, tolerance_m);
  }

  std::string camera_frame_ = "left_camera";
  ros::Time stamp_;
  ros::NodeHandle nh_;
  tf2_ros::Buffer tf_buffer_;
  ros::Publisher left_;
  ros::Publisher right_;

 private:
  void takeOdometry(const nav_msgs::OdometryConstPtr& odometry) {
    EXPECT_TRUE(isFinite(*odometry));
    const std::lock_guard<std::mutex> lock(mutex_);
    odometries_[odometry->header.stamp] = *odometry;
  }

  void takeInfo(const OdometryInfoConstPtr& info) {
    const std::lock_guard<std::mutex> lock(mutex_);
    last_info_ = *info;
  }

  const Scene scene_;
  bool loaded_ = false;
  tf2_ros::TransformListener tf_listener_;
  tf2_ros::StaticTransformBroadcaster broadcaster_;
  ros::Publisher left_info_;
  ros::Publisher right_info_;
  ros::Subscriber odometry_;
  ros::Subscriber info_;
  ros::AsyncSpinner spinner_;
  mutable std::mutex mutex_;
  std::map<ros::Time, nav_msgs::Odometry> odometries_;
  OdometryInfo last_info_;
};

TEST_F(NodeletTest, MeasuresTheMotionInTheAxesOfTheBase) {
  ASSERT_TRUE(load());
  const int frames = 15;
  const nav_msgs::Odometry odometry = drive(0, frames);
  EXPECT_EQ(odometry.header.frame_id, "odom");
  EXPECT_EQ(odometry.child_frame_id, "base_link");
  expectPosition(odometry, (frames - 1) * kForwardStep_m, -(frames - 1) * kRightStep_m);
  EXPECT_NEAR(odometry.twist.twist.linear.x, kForwardStep_m / kFramePeriod_s, 0.1);
  EXPECT_NEAR(odometry.twist.twist.linear.y, -kRightStep_m / kFramePeriod_s, 0.1);
  EXPECT_GT(odometry.pose.covariance[0], 0.0);
  EXPECT_GT(odometry.twist.covariance[0], 0.0);

  ASSERT_TRUE(waitFor([this] { return tf_buffer_.canTransform("odom", "base_link", stamp_); }));
  const auto transform = tf_buffer_.lookupTransform("odom", "base_link", stamp_);
  EXPECT_DOUBLE_EQ(transform.transform.translation.x, odometry.pose.pose.position.x);
  EXPECT_DOUBLE_EQ(transform.transform.translation.y, odometry.pose.pose.position.y);

  ASSERT_TRUE(waitFor([this] { return lastInfo().header.stamp == stamp_; }));
  const OdometryInfo info = lastInfo();
  EXPECT_EQ(info.state, OdometryInfo::OK) << info.reason;
  EXPECT_EQ(info.header.frame_id, "left_camera");
  EXPECT_EQ(info.frames_processed, static_cast<std::uint64_t>(frames));
  EXPECT_EQ(info.frames_dropped + info.frames_rejected + info.exceptions, 0U);
  EXPECT_GT(info.point_inliers, 0U);
}

TEST_F(NodeletTest, SurvivesMalformedImagesBetweenGoodOnes) {
  ASSERT_TRUE(load());
  drive(0, 5);
  publishFrame(5, [](sensor_msgs::Image* image) { image->data.resize(100); });
  publishFrame(5, [](sensor_msgs::Image* image) { image->encoding = "nonsense"; });
  publishFrame(5, [](sensor_msgs::Image* image) { image->width = 0; });
  const nav_msgs::Odometry odometry = drive(5, 10);
  expectPosition(odometry, 9 * kForwardStep_m, -9 * kRightStep_m);
  ASSERT_TRUE(waitFor([this] { return lastInfo().header.stamp == stamp_; }));
  EXPECT_EQ(lastInfo().frames_rejected, 3U);
  EXPECT_EQ(lastInfo().frames_processed, 10U);
}

TEST_F(NodeletTest, ResetsOnlyOnRequest) {
  ASSERT_TRUE(load());
  drive(0, 5);
  ASSERT_TRUE(callTrigger("reset"));
  expectPosition(drive(5, 6), 0.0, 0.0, 1e-9);

  ResetToPose service;
  EXPECT_TRUE(call("/stereo/odometry/reset_to_pose", &service));
  EXPECT_FALSE(service.response.success) << "a quaternion of zeros is not an orientation";
  service.request.pose.orientation.z = 1.0;  // looking back
  service.request.pose.position.x = 1e300;
  ASSERT_TRUE(call("/stereo/odometry/reset_to_pose", &service));
  EXPECT_FALSE(service.response.success) << "no robot is there";
  service.request.pose.position.x = 7.0;
  ASSERT_TRUE(call("/stereo/odometry/reset_to_pose", &service));
  EXPECT_TRUE(service.response.success) << service.response.message;
  expectPosition(drive(6, 7), 7.0, 0.0, 1e-9);
  expectPosition(drive(7, 10), 7.0 - 3 * kForwardStep_m, 3 * kRightStep_m);
}

TEST_F(NodeletTest, PausesAndGoesOn) {
  ASSERT_TRUE(load());
  drive(0, 3);
  ASSERT_TRUE(callTrigger("pause"));
  publishFrame(3);
  EXPECT_FALSE(waitFor([this] { return hasOdometry(stamp_); }, 0.5));
  ASSERT_TRUE(callTrigger("resume"));
  expectPosition(drive(4, 6), 5 * kForwardStep_m, -5 * kRightStep_m);
}

TEST_F(NodeletTest, IsResetWhenStampsJumpBack) {
  ASSERT_TRUE(load());
  drive(0, 4);
  stamp_ -= ros::Duration(100.0);
  publishFrame(4);
  const ros::Time first = stamp_;
  publishFrame(5);
  EXPECT_FALSE(waitFor([this] { return hasOdometry(stamp_); }, 0.5)) << "not confirmed yet";
  expectPosition(drive(6, 8), 3 * kForwardStep_m, -3 * kRightStep_m);
  expectPosition(odometryAt(first), 0.0, 0.0, 1e-9);
}

TEST_F(NodeletTest, WaitsForTheTransformToTheCamera) {
  ASSERT_TRUE(load());
  camera_frame_ = "late_camera";
  publishFrame(0);
  EXPECT_FALSE(waitFor([this] { return hasOdometry(stamp_); }, 0.5));
  sendMounting(camera_frame_);
  EXPECT_TRUE(waitFor([this] { return hasOdometry(stamp_); }));
}

TEST_F(NodeletTest, PublishesImagesAndMarkersToSubscribers) {
  ASSERT_TRUE(load());
  drive(0, 2);
  std::atomic<int> images{0};
  const boost::function<void(const sensor_msgs::ImageConstPtr&)> count =
      [&images](const sensor_msgs::ImageConstPtr& image) {
        if (image->encoding == "bgr8" && image->width == kWidth) ++images;
      };
  const ros::Subscriber subscriber = nh_.subscribe("features_image", 10, count);
  ASSERT_TRUE(waitFor([&subscriber] { return subscriber.getNumPublishers() > 0; }));
  int k = 2;
  EXPECT_TRUE(waitFor([&] {
    drive(k, k + 1);
    ++k;
    return images > 0;
  }));
}

TEST_F(NodeletTest, AcceptsRequestsWhileImagesArrive) {
  ASSERT_TRUE(load());
  std::atomic<bool> stop{false};
  std::thread camera([this, &stop] {
    for (int k = 0; !stop; ++k) publishFrame(k % 20);
  });
  ResetToPose service;
  service.request.pose.orientation.w = 1.0;
  for (int round = 0; round < 10; ++round) {
    EXPECT_TRUE(callTrigger("reset"));
    EXPECT_TRUE(callTrigger("pause"));
    EXPECT_TRUE(callTrigger("resume"));
    ros::WallDuration(0.05).sleep();
    EXPECT_TRUE(call("/stereo/odometry/reset_to_pose", &service));
    EXPECT_TRUE(service.response.success) << service.response.message;
  }
  stop = true;
  camera.join();
  EXPECT_TRUE(waitFor([this] { return hasOdometry(stamp_); }));
  ASSERT_TRUE(callTrigger("reset"));
  expectPosition(drive(0, 1), 0.0, 0.0, 1e-9);
  ASSERT_TRUE(waitFor([this] { return lastInfo().header.stamp == stamp_; }));
  EXPECT_EQ(lastInfo().exceptions + lastInfo().frames_rejected, 0U);
}

TEST_F(NodeletTest, UnloadsWhileImagesArrive) {
  for (int round = 0; round < 3; ++round) {
    ASSERT_TRUE(load());
    std::atomic<bool> stop{false};
    std::thread camera([this, &stop] {
      for (int k = 0; !stop; ++k) publishFrame(k % 20);
    });
    ros::WallDuration(0.5).sleep();
    EXPECT_TRUE(unload());
    stop = true;
    camera.join();
  }
  nodelet::NodeletList list;
  ASSERT_TRUE(call("/manager/list", &list)) << "the manager has crashed";
  EXPECT_TRUE(list.response.nodelets.empty());
}

TEST_F(NodeletTest, RefusesUnknownParameters) {
  ros::param::set("/stereo/odometry/no_such_parameter", 1);
  EXPECT_FALSE(load());
  ros::param::del("/stereo/odometry/no_such_parameter");
  EXPECT_TRUE(load());
}

}  // namespace
}  // namespace point_line_odometry

int main(int argc, char** argv) {
  ::testing::InitGoogleTest(&argc, argv);
  ros::init(argc, argv, "nodelet_test");
  const ros::NodeHandle keep_running;
  return RUN_ALL_TESTS();
}
