/// The nodelet, loaded into this process, under faults of its messages: what it publishes and logs.
/// Faults of the images are tested by faults_test.

#include <diagnostic_msgs/DiagnosticArray.h>
#include <gtest/gtest.h>
#include <nav_msgs/Odometry.h>
#include <nodelet/loader.h>
#include <point_line_odometry/OdometryInfo.h>
#include <ros/ros.h>
#include <sensor_msgs/CameraInfo.h>
#include <sensor_msgs/Image.h>
#include <tf2_ros/buffer.h>
#include <tf2_ros/static_transform_broadcaster.h>
#include <tf2_ros/transform_listener.h>

#include <cmath>
#include <functional>
#include <limits>
#include <map>
#include <mutex>
#include <new>
#include <opencv2/core.hpp>
#include <string>
#include <vector>

#include "failing_allocator.h"
#include "ros/camera_messages.h"
#include "ros/confirmation.h"
#include "synthetic_scene.h"

namespace point_line_odometry {
namespace {

constexpr const char* kName = "/stereo/odometry";
constexpr double kTimeout_s = 20.0;
constexpr double kWatchdog_s = 0.5;
constexpr double kDiagnosticPeriod_s = 0.1;
constexpr double kPeriod_s = 1e-9 * synthetic::kPeriodNs;
constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();

/// The messages of one stereo frame.
struct Messages {
  sensor_msgs::Image left;
  sensor_msgs::Image right;
  sensor_msgs::CameraInfo left_info;
  sensor_msgs::CameraInfo right_info;
};

using Spoil = std::function<void(Messages*)>;

sensor_msgs::CameraInfo cameraInfo(double baseline_m, const std_msgs::Header& header) {
  const StereoCamera camera = synthetic::roomCamera();
  sensor_msgs::CameraInfo info;
  info.header = header;
  info.width = static_cast<std::uint32_t>(camera.width);
  info.height = static_cast<std::uint32_t>(camera.height);
  info.P = {camera.fx, 0, camera.cx, -camera.fx * baseline_m, 0, camera.fy, camera.cy, 0, 0,
            0,         1, 0};
  return info;
}

bool isFinite(const nav_msgs::Odometry& odometry) {
  const auto& p = odometry.pose.pose.position;
  const auto& q = odometry.pose.pose.orientation;
  double sum = p.x + p.y + p.z + q.x + q.y + q.z + q.w;
  for (const double c : odometry.pose.covariance) sum += c;
  for (const double c : odometry.twist.covariance) sum += c;
  return std::isfinite(sum);
}

bool contains(const std::string& text, const std::string& words) {
  return text.find(words) != std::string::npos;
}

/// Loads the nodelet with `set()` parameters, publishes as the camera and subscribes to the
/// results. The base is the camera, unless a test sets another one.
class NodeletFaultsTest : public ::testing::Test {
 protected:
  NodeletFaultsTest() : nh_("stereo"), loader_(false), spinner_(2) {
    left_ = nh_.advertise<sensor_msgs::Image>("left/image_rect", 10);
    right_ = nh_.advertise<sensor_msgs::Image>("right/image_rect", 10);
    left_info_ = nh_.advertise<sensor_msgs::CameraInfo>("left/camera_info", 10);
    right_info_ = nh_.advertise<sensor_msgs::CameraInfo>("right/camera_info", 10);
    odometry_ = nh_.subscribe("odom", 100, &NodeletFaultsTest::takeOdometry, this);
    info_ = nh_.subscribe("info", 100, &NodeletFaultsTest::takeInfo, this);
    diagnostics_ = nh_.subscribe("/diagnostics", 100, &NodeletFaultsTest::takeDiagnostics, this);
    set("base_frame_id", std::string("camera"));
    set("watchdog_timeout_s", kWatchdog_s);
    set("diagnostic_period", kDiagnosticPeriod_s);
    spinner_.start();
  }

  void TearDown() override {
    loader_.unload(kName);
    spinner_.stop();
    ros::param::del(kName);
  }

  template <typename T>
  static void set(const std::string& name, const T& value) {
    ros::param::set(std::string(kName) + "/" + name, value);
  }

  bool load() {
    if (!loader_.load(kName, "point_line_odometry/StereoOdometry", {}, {})) return false;
    return waitFor([this] {
      return left_.getNumSubscribers() > 0 && right_.getNumSubscribers() > 0 &&
             left_info_.getNumSubscribers() > 0 && right_info_.getNumSubscribers() > 0 &&
             odometry_.getNumPublishers() > 0 && info_.getNumPublishers() > 0 &&
             diagnostics_.getNumPublishers() > 0;
    });
  }

  static bool waitFor(const std::function<bool()>& condition, double timeout_s = kTimeout_s) {
    const ros::SteadyTime end = ros::SteadyTime::now() + ros::WallDuration(timeout_s);
    while (!condition()) {
      if (ros::SteadyTime::now() > end) return false;
      ros::WallDuration(0.005).sleep();
    }
    return true;
  }

  /// Frame k of synthetic::frame(), at the present stamp.
  Messages makeMessages(int k, double baseline_m = synthetic::roomCamera().baseline_m) const {
    const std_msgs::Header header = makeHeader("camera", stamp_);
    const StereoImages& images = synthetic::frame(k);
    return {*toImageMessage(images.left, header), *toImageMessage(images.right, header),
            cameraInfo(0.0, header), cameraInfo(baseline_m, header)};
  }

  void publish(const Messages& messages) const {
    publishImages(messages);
    left_info_.publish(messages.left_info);
    right_info_.publish(messages.right_info);
  }

  void publishImages(const Messages& messages) const {
    left_.publish(messages.left);
    right_.publish(messages.right);
  }

  /// As if the right camera had stopped; its driver may go on with camera_info.
  void publishWithoutRightImage(const Messages& messages) const {
    left_.publish(messages.left);
    left_info_.publish(messages.left_info);
    right_info_.publish(messages.right_info);
  }

  /// Publishes frame k at the next stamp.
  void show(int k, const Spoil& spoil = nullptr) {
    stamp_ += ros::Duration(kPeriod_s);
    Messages messages = makeMessages(k);
    if (spoil) spoil(&messages);
    publish(messages);
  }

  /// Publishes frames [begin, end), each after the answer to the one before. Returns the last
  /// answer.
  OdometryInfo drive(int begin, int end, const Spoil& spoil = nullptr) {
    for (int k = begin; k < end; ++k) {
      show(k, spoil);
      EXPECT_TRUE(waitFor([this] { return answered(); })) << "no answer to frame " << k;
    }
    return infoAt(stamp_);
  }

  bool answered() const {
    const std::lock_guard<std::mutex> lock(mutex_);
    return odometries_.count(stamp_) > 0 && infos_.count(stamp_) > 0;
  }

  OdometryInfo infoAt(const ros::Time& stamp) const {
    const std::lock_guard<std::mutex> lock(mutex_);
    const auto found = infos_.find(stamp);
    return found == infos_.end() ? OdometryInfo() : found->second;
  }

  std::size_t numOdometries() const {
    const std::lock_guard<std::mutex> lock(mutex_);
    return odometries_.size();
  }

  geometry_msgs::Point position() const {
    const std::lock_guard<std::mutex> lock(mutex_);
    const auto found = odometries_.find(stamp_);
    return found == odometries_.end() ? geometry_msgs::Point() : found->second.pose.pose.position;
  }

  /// Asserts the pose of the last odometry; that of frame 0 is the origin of odom.
  void expectAt(const Eigen::Isometry3d& T_odom_camera, double tolerance_m = 0.02) const {
    const geometry_msgs::Point p = position();
    EXPECT_LT((Eigen::Vector3d(p.x, p.y, p.z) - T_odom_camera.translation()).norm(), tolerance_m);
  }

  /// Waits until a status of /diagnostics has this level and these words.
  bool says(const std::string& status, int level, const std::string& words) const {
    return waitFor(
        [&] {
          const std::lock_guard<std::mutex> lock(mutex_);
          const auto found = statuses_.find(status);
          return found != statuses_.end() && found->second.level == level &&
                 contains(found->second.message, words);
        },
        8.0);
  }

  std::string said(const std::string& status) const {
    const std::lock_guard<std::mutex> lock(mutex_);
    const auto found = statuses_.find(status);
    return found == statuses_.end() ? "nothing" : found->second.message;
  }

  std::string valueOf(const std::string& status, const std::string& key) const {
    const std::lock_guard<std::mutex> lock(mutex_);
    const auto found = statuses_.find(status);
    if (found == statuses_.end()) return "";
    for (const auto& entry : found->second.values) {
      if (entry.key == key) return entry.value;
    }
    return "";
  }

  int counted(const std::string& status, const std::string& key) const {
    const std::string value = valueOf(status, key);
    return value.empty() ? -1 : std::stoi(value);
  }

  static constexpr int kError = diagnostic_msgs::DiagnosticStatus::ERROR;
  static constexpr int kWarn = diagnostic_msgs::DiagnosticStatus::WARN;

  ros::Time stamp_ = ros::Time(1000.0);
  ros::NodeHandle nh_;

 private:
  void takeOdometry(const nav_msgs::OdometryConstPtr& odometry) {
    EXPECT_TRUE(isFinite(*odometry));
    const std::lock_guard<std::mutex> lock(mutex_);
    odometries_[odometry->header.stamp] = *odometry;
  }

  void takeInfo(const OdometryInfoConstPtr& info) {
    const std::lock_guard<std::mutex> lock(mutex_);
    infos_[info->header.stamp] = *info;
  }

  void takeDiagnostics(const diagnostic_msgs::DiagnosticArrayConstPtr& array) {
    const std::lock_guard<std::mutex> lock(mutex_);
    for (const auto& status : array->status) {
      statuses_[status.name.substr(status.name.rfind(' ') + 1)] = status;
    }
  }

  nodelet::Loader loader_;
  ros::Publisher left_;
  ros::Publisher right_;
  ros::Publisher left_info_;
  ros::Publisher right_info_;
  ros::Subscriber odometry_;
  ros::Subscriber info_;
  ros::Subscriber diagnostics_;
  ros::AsyncSpinner spinner_;
  mutable std::mutex mutex_;
  std::map<ros::Time, nav_msgs::Odometry> odometries_;
  std::map<ros::Time, OdometryInfo> infos_;
  std::map<std::string, diagnostic_msgs::DiagnosticStatus> statuses_;
};

// --- Messages that are refused

struct RefusedCase {
  const char* name;
  const char* words;  // in /diagnostics
  Spoil spoil;
};

std::vector<RefusedCase> badImages() {
  return {
      {"unknown_encoding", "'nonsense' is not supported",
       [](Messages* m) { m->left.encoding = "nonsense"; }},
      {"bayer", "debayer", [](Messages* m) { m->right.encoding = "bayer_rggb8"; }},
      {"zero_width", "empty", [](Messages* m) { m->left.width = 0; }},
      {"zero_height", "empty", [](Messages* m) { m->right.height = 0; }},
      {"short_step", "step is 399", [](Messages* m) { m->left.step = 399; }},
      {"wide_encoding", "takes 1200", [](Messages* m) { m->left.encoding = "bgr8"; }},
      {"cut_off", "data has 100 bytes", [](Messages* m) { m->left.data.resize(100); }},
      {"no_data", "data has 0 bytes", [](Messages* m) { m->right.data.clear(); }},
      {"too_much_data", "data has 112001 bytes", [](Messages* m) { m->right.data.push_back(0); }},
      {"huge", "larger than any camera", [](Messages* m) { m->left.height = 0xffffffff; }},
      {"left_of_another_size", "left image is 400 x 140",
       [](Messages* m) {
         m->left.height = 140;
         m->left.data.resize(56000);
       }},
      {"right_of_another_size", "right image is 400 x 140",
       [](Messages* m) {
         m->right.height = 140;
         m->right.data.resize(56000);
       }},
  };
}

/// Invalid camera_infos; the left camera's P is {fx 0 cx Tx, 0 fy cy Ty, 0 0 1 0}.
std::vector<RefusedCase> badInfos() {
  return {
      {"P_all_zero", "left/camera_info: P is all zero",
       [](Messages* m) { m->left_info.P.assign(0.0); }},
      {"P_of_NaN", "right/camera_info: P has an entry",
       [](Messages* m) { m->right_info.P[2] = kNaN; }},
      {"negative_f", "P[0] (fx) is -300", [](Messages* m) { m->left_info.P[0] = -300.0; }},
      {"zero_f", "P[5] (fy) is 0", [](Messages* m) { m->right_info.P[5] = 0.0; }},
      {"no_baseline", "both topics carry the left camera's info",
       [](Messages* m) { m->right_info = m->left_info; }},
      {"negative_baseline", "swapped", [](Messages* m) { m->right_info.P[3] = 60.0; }},
      {"swapped", "swapped", [](Messages* m) { std::swap(m->left_info, m->right_info); }},
      {"no_size", "width is 0", [](Messages* m) { m->left_info.width = 0; }},
      {"sizes_differ", "same resolution", [](Messages* m) { m->right_info.width = 200; }},
      {"binned", "describes 200 x 140",
       [](Messages* m) {
         for (auto* info : {&m->left_info, &m->right_info}) info->binning_x = info->binning_y = 2;
       }},
  };
}

class RefusedTest : public NodeletFaultsTest, public ::testing::WithParamInterface<RefusedCase> {};

/// Nothing is published, the reason is reported, the frame is counted; the next ones are processed.
TEST_P(RefusedTest, IsNamedCountedAndSkipped) {
  ASSERT_TRUE(load());
  drive(0, 3);
  const std::size_t answers = numOdometries();
  show(3, GetParam().spoil);
  EXPECT_TRUE(says("tracking", kError, GetParam().words)) << said("tracking");
  EXPECT_EQ(counted("tracking", "frames rejected"), 1);
  EXPECT_EQ(counted("tracking", "failed windows"), 0);
  EXPECT_EQ(valueOf("tracking", "line detector"), "edge_chains");
  EXPECT_EQ(numOdometries(), answers);
  const OdometryInfo info = drive(4, 6);
  EXPECT_EQ(info.state, OdometryInfo::OK) << info.reason;
  EXPECT_EQ(info.frames_rejected, 1U);
  EXPECT_EQ(info.frames_processed, 5U);
  EXPECT_EQ(info.exceptions, 0U);
  expectAt(synthetic::truePose(5));
}

std::string nameOf(const ::testing::TestParamInfo<RefusedCase>& info) { return info.param.name; }

INSTANTIATE_TEST_SUITE_P(Images, RefusedTest, ::testing::ValuesIn(badImages()), nameOf);
INSTANTIATE_TEST_SUITE_P(Infos, RefusedTest, ::testing::ValuesIn(badInfos()), nameOf);

TEST_F(NodeletFaultsTest, DoesNotStartWithAnInvalidCalibration) {
  ASSERT_TRUE(load());
  const Spoil swapped = [](Messages* m) { std::swap(m->left_info, m->right_info); };
  for (int k = 0; k < 3; ++k) show(k, swapped);
  EXPECT_TRUE(says("tracking", kError, "swapped")) << said("tracking");
  EXPECT_EQ(numOdometries(), 0U);
  EXPECT_EQ(drive(3, 4).state, OdometryInfo::INITIALIZING);
}

/// The middle of the image at half the resolution, as a driver with region of interest and binning
/// sends it.
TEST_F(NodeletFaultsTest, ScalesPByRegionAndBinning) {
  ASSERT_TRUE(load());
  const Spoil large = [](Messages* m) {
    for (auto* info : {&m->left_info, &m->right_info}) {
      info->width = 1000;
      info->height = 800;
      info->roi.x_offset = 100;
      info->roi.y_offset = 60;
      info->roi.width = 800;
      info->roi.height = 560;
      info->binning_x = info->binning_y = 2;
      info->P[0] *= 2.0;
      info->P[5] *= 2.0;
      info->P[3] *= 2.0;
      info->P[2] = 2.0 * info->P[2] + 100.0;
      info->P[6] = 2.0 * info->P[6] + 60.0;
    }
  };
  EXPECT_EQ(drive(0, 6, large).state, OdometryInfo::OK);
  expectAt(synthetic::truePose(5));
}

/// Fields that are not used for rectified images may have any value.
TEST_F(NodeletFaultsTest, AcceptsNaNInUnusedFields) {
  ASSERT_TRUE(load());
  const OdometryInfo info =
      drive(0, 4, [](Messages* m) { m->left_info.K[0] = m->right_info.R[4] = kNaN; });
  EXPECT_EQ(info.state, OdometryInfo::OK) << info.reason;
}

/// Another valid calibration.
void changeCalibration(Messages* messages) {
  for (auto* info : {&messages->left_info, &messages->right_info}) info->P[2] += 0.2;
}

/// Nor does the manager end, with all of its other nodelets.
TEST_F(NodeletFaultsTest, AStartThatFailsLeavesTheManagerAsItWas) {
  const std::string no_file = "/no/such/mask.png";
  for (int k = 0; k < 3; ++k) {
    set("left/mask", no_file);
    EXPECT_FALSE(load());
    set("left/mask", std::string("none"));
    set("image_transport", std::string("none_such"));
    EXPECT_FALSE(load());
    set("image_transport", std::string("raw"));
  }
  ASSERT_TRUE(load());
  EXPECT_EQ(drive(0, 3).state, OdometryInfo::OK);
}

/// The pose goes on: it is predicted for the frames that confirm the calibration.
TEST_F(NodeletFaultsTest, AcceptsAnotherCalibrationThatStaysAndGoesOn) {
  ASSERT_TRUE(load());
  drive(0, 3);
  const std::size_t answers = numOdometries();
  int k = 3;
  for (; k < 2 + kConfirmations; ++k) {
    show(k, changeCalibration);
    EXPECT_TRUE(says("tracking", kError, "camera_info: P is not as in the frames before"))
        << said("tracking");
  }
  EXPECT_EQ(numOdometries(), answers);
  EXPECT_EQ(drive(k, k + 1, changeCalibration).state, OdometryInfo::DEGRADED);
  expectAt(synthetic::truePose(k), 0.05);
  EXPECT_EQ(drive(k + 1, k + 3, changeCalibration).state, OdometryInfo::OK);
  expectAt(synthetic::truePose(k + 2), 0.06);
}

/// A single message that differs changes nothing, even if it is valid.
struct OddCase {
  const char* name;
  const char* words;
  Spoil spoil;
};

std::vector<OddCase> oddHeadersAndInfos() {
  const auto frame_id = [](const std::string& name) {
    return [name](Messages* m) { m->left.header.frame_id = name; };
  };
  return {
      {"calibration", "left/camera_info: P is not", changeCalibration},
      {"right_baseline", "right/camera_info: P is not",
       [](Messages* m) { m->right_info.P[3] *= 2.0; }},
      {"distortion", "left/camera_info: D is not",
       [](Messages* m) { m->left_info.D.assign(3, kNaN); }},
      {"offset_of_region", "P of the left and right camera differ",
       [](Messages* m) { m->right_info.roi.y_offset = 4294967295U; }},
      {"frame_id_of_base", "frame_id is 'robot' instead of 'camera'", frame_id("robot")},
      {"frame_id_unknown", "frame_id is 'nowhere' instead of", frame_id("nowhere")},
      {"frame_id_empty", "frame_id is '' instead of", frame_id("")},
      {"frame_id_slashes", "frame_id is '//camera' instead of", frame_id("//camera")},
      {"frame_id_odd", "instead of 'camera'", frame_id("%s%n \t\x7f/")},
  };
}

class OddTest : public NodeletFaultsTest, public ::testing::WithParamInterface<OddCase> {};

TEST_P(OddTest, InOneFrameIsNamedCountedAndSkipped) {
  set("base_frame_id", std::string("robot"));
  ASSERT_TRUE(load());
  geometry_msgs::TransformStamped mounting;
  mounting.header.frame_id = "robot";
  mounting.child_frame_id = "camera";
  mounting.transform.translation.x = 0.5;
  mounting.transform.rotation.w = 1.0;
  tf2_ros::StaticTransformBroadcaster broadcaster;
  broadcaster.sendTransform(mounting);
  drive(0, 3);
  show(3, GetParam().spoil);
  EXPECT_TRUE(says("tracking", kError, GetParam().words)) << said("tracking");
  const OdometryInfo info = drive(4, 6);
  EXPECT_EQ(info.state, OdometryInfo::OK) << info.reason;
  EXPECT_EQ(info.frames_processed, 5U);
  EXPECT_EQ(info.frames_rejected, 1U);
  EXPECT_EQ(info.exceptions, 0U);
  const Eigen::Translation3d T_base_camera(0.5, 0.0, 0.0);
  expectAt(T_base_camera * synthetic::truePose(5) * T_base_camera.inverse());
}

INSTANTIATE_TEST_SUITE_P(Messages, OddTest, ::testing::ValuesIn(oddHeadersAndInfos()),
                         [](const auto& info) { return std::string(info.param.name); });

// --- Missing messages

TEST_F(NodeletFaultsTest, NamesTheCameraThatStops) {
  ASSERT_TRUE(load());
  drive(0, 3);
  const std::size_t answers = numOdometries();
  for (int k = 0; k < 8; ++k) {
    stamp_ += ros::Duration(kPeriod_s);
    publishWithoutRightImage(makeMessages(k % 4));
    ros::WallDuration(kPeriod_s).sleep();
  }
  EXPECT_TRUE(says("input", kError, "nothing arrives on /stereo/right/image_rect any more"))
      << said("input");
  EXPECT_EQ(numOdometries(), answers);
  EXPECT_TRUE(waitFor([this] {
    show(3);
    ros::WallDuration(kPeriod_s).sleep();
    return said("input") == "receiving stereo images";
  })) << said("input");
}

TEST_F(NodeletFaultsTest, NamesTheInfoThatNeverComes) {
  ASSERT_TRUE(load());
  for (int k = 0; k < 3; ++k) {
    stamp_ += ros::Duration(kPeriod_s);
    publishImages(makeMessages(k));
  }
  EXPECT_TRUE(says("input", kError,
                   "nothing arrives on /stereo/left/camera_info and /stereo/right/camera_info"))
      << said("input");
  EXPECT_EQ(numOdometries(), 0U);
}

TEST_F(NodeletFaultsTest, ReportsThatAllHaveStopped) {
  ASSERT_TRUE(load());
  drive(0, 3);
  EXPECT_TRUE(says("input", kError, "the camera has stopped publishing")) << said("input");
}

TEST_F(NodeletFaultsTest, SkipsCountsAndExplainsPairsWhoseStampsDiffer) {
  ASSERT_TRUE(load());
  drive(0, 3);
  const std::size_t answers = numOdometries();
  for (int k = 3; k < 7; ++k) {
    show(k, [](Messages* m) {
      m->right.header.stamp += ros::Duration(0.004);
      m->right_info.header.stamp = m->right.header.stamp;
    });
    ros::WallDuration(kPeriod_s).sleep();
  }
  EXPECT_TRUE(says("input", kError, "approximate_sync")) << said("input");
  EXPECT_TRUE(waitFor([&] { return counted("input", "left images without partner") == 4; }));
  EXPECT_EQ(numOdometries(), answers);
}

TEST_F(NodeletFaultsTest, WaitsForTheTransformAndReportsIt) {
  set("base_frame_id", std::string("robot"));
  ASSERT_TRUE(load());
  show(0);
  EXPECT_TRUE(says("tracking", kError, "no transform from robot to camera")) << said("tracking");
  EXPECT_EQ(numOdometries(), 0U);
  geometry_msgs::TransformStamped mounting;
  mounting.header.frame_id = "robot";
  mounting.child_frame_id = "camera";
  mounting.transform.rotation.w = kNaN;
  tf2_ros::StaticTransformBroadcaster broadcaster;
  broadcaster.sendTransform(mounting);  // tf refuses it
  EXPECT_FALSE(waitFor([this] { return answered(); }, 0.3));
  mounting.transform.rotation.w = 1.0;
  broadcaster.sendTransform(mounting);
  EXPECT_TRUE(waitFor([this] { return answered(); }));
}

// --- Stamps

TEST_F(NodeletFaultsTest, DropsFramesThatComeTwiceOrLate) {
  ASSERT_TRUE(load());
  drive(0, 4);
  const std::size_t answers = numOdometries();
  publish(makeMessages(3));
  ros::WallDuration(kPeriod_s).sleep();  // messages of two frames arrive in any order
  const ros::Time newest = stamp_;
  stamp_ = newest - ros::Duration(0.25);  // not of a frame before
  publish(makeMessages(1));
  ros::WallDuration(kPeriod_s).sleep();
  stamp_ = newest;
  const OdometryInfo info = drive(4, 6);
  EXPECT_EQ(info.state, OdometryInfo::OK) << info.reason;
  EXPECT_EQ(info.frames_rejected, 2U);
  EXPECT_EQ(numOdometries(), answers + 2);
  expectAt(synthetic::truePose(5));
}

/// Wild stamps of a pair, or of one message of it: they are counted and named, without other
/// effect.
struct WildCase {
  const char* name;
  const char* words;  // in /diagnostics
  std::function<ros::Time(const ros::Time&)> wild;
};

std::vector<WildCase> wildStamps() {
  const auto always = [](const ros::Time& stamp) {
    return [stamp](const ros::Time&) { return stamp; };
  };
  return {
      {"zero", "stamp 0.000000000 is no valid time", always(ros::Time())},
      {"end", "stamp 4294967295.000000000 is out of", always(ros::Time(4294967295U, 0))},
      {"very_end", "4294967295.999999999", always(ros::Time(4294967295U, 999999999U))},
      {"far_future", "stamp 3000000000.000000000 is far", always(ros::Time(3000000000U, 0))},
      {"far_past", "stamp 0.000000001 is far", always(ros::Time(0, 1))},
      {"ahead", "is far from", [](const ros::Time& t) { return t + ros::Duration(3600.0); }},
      {"behind", "is far from", [](const ros::Time& t) { return t - ros::Duration(30.0); }},
  };
}

class WildStampTest : public NodeletFaultsTest, public ::testing::WithParamInterface<WildCase> {
 protected:
  /// Expects that the next frames are processed as if nothing had happened.
  void expectUndisturbed(int next, std::uint64_t rejected) {
    const OdometryInfo info = drive(next, next + 2);
    EXPECT_EQ(info.state, OdometryInfo::OK) << info.reason;
    EXPECT_EQ(info.stamps_rejected, rejected);
    EXPECT_EQ(info.frames_rejected, 0U);
    EXPECT_EQ(info.exceptions, 0U);
    expectAt(synthetic::truePose(next + 1));
  }
};

TEST_P(WildStampTest, OfAPairIsCountedAndNamedOnly) {
  set("watchdog_timeout_s", kTimeout_s);
  tf2_ros::Buffer of_others;  // would throw at such a stamp, as that of any nodelet
  const tf2_ros::TransformListener listener(of_others);
  ASSERT_TRUE(load());
  drive(0, 3);
  std::uint64_t rejected = 0;
  for (const int next : {3, 5}) {
    const std::size_t answers = numOdometries();
    const ros::Time present = stamp_;
    stamp_ = GetParam().wild(present);
    publish(makeMessages(0));
    stamp_ = present;
    rejected += 4;
    expectUndisturbed(next, rejected);
    EXPECT_EQ(numOdometries(), answers + 2);
  }
  EXPECT_TRUE(says("input", kWarn, GetParam().words)) << said("input");
  EXPECT_TRUE(waitFor([&] { return counted("input", "messages rejected for their stamp") == 8; }));
}

TEST_P(WildStampTest, OfOneCameraIsHarmless) {
  ASSERT_TRUE(load());
  drive(0, 3);
  for (const bool left : {true, false}) {
    show(3, [&](Messages* m) {
      auto& image = left ? m->left : m->right;
      auto& info = left ? m->left_info : m->right_info;
      image.header.stamp = info.header.stamp = GetParam().wild(stamp_);
    });
  }
  expectUndisturbed(4, 4);
}

INSTANTIATE_TEST_SUITE_P(Stamps, WildStampTest, ::testing::ValuesIn(wildStamps()),
                         [](const auto& info) { return std::string(info.param.name); });

TEST_F(NodeletFaultsTest, ExplainsThatAllStampsAreZero) {
  ASSERT_TRUE(load());
  for (int k = 0; k < 3; ++k) {
    stamp_ = ros::Time();
    publish(makeMessages(k));
  }
  EXPECT_TRUE(says("input", kError, "12 messages were rejected for their stamps")) << said("input");
  EXPECT_EQ(numOdometries(), 0U);
}

class TimeJumpTest : public NodeletFaultsTest, public ::testing::WithParamInterface<const char*> {
 protected:
  /// Publishes frames [begin, end) after a jump, which the last of them confirms.
  OdometryInfo confirmJump(int begin, int end) {
    const std::size_t answers = numOdometries();
    for (int k = begin; k < end; ++k) {
      EXPECT_EQ(numOdometries(), answers) << "not confirmed yet";
      show(k);
      ros::WallDuration(kPeriod_s).sleep();
    }
    EXPECT_TRUE(waitFor([this] { return answered(); }));
    EXPECT_EQ(numOdometries(), answers + static_cast<std::size_t>(end - begin));
    return infoAt(stamp_ - ros::Duration((end - begin - 1) * kPeriod_s));
  }
};

TEST_P(TimeJumpTest, FollowsThePolicy) {
  const std::string policy = GetParam();
  set("on_time_jump", policy);
  ASSERT_TRUE(load());
  drive(0, 4);
  stamp_ -= ros::Duration(500.0);
  if (policy == "ignore") {
    const std::size_t answers = numOdometries();
    for (int k = 4; k < 7; ++k) show(k);
    EXPECT_TRUE(says("tracking", kError, "stamp_not_newer")) << said("tracking");
    EXPECT_EQ(numOdometries(), answers);
    return;
  }
  EXPECT_EQ(confirmJump(3, 3 + kConfirmations).state, OdometryInfo::INITIALIZING);
  const OdometryInfo info = drive(6, 7);
  EXPECT_EQ(info.state, OdometryInfo::OK) << info.reason;
  EXPECT_EQ(info.frames_rejected, 0U);
  EXPECT_EQ(info.stamps_rejected, 0U);
  const Eigen::Isometry3d moved = synthetic::truePose(3).inverse() * synthetic::truePose(6);
  expectAt(policy == "reset" ? moved : synthetic::truePose(6), 0.03);
}

/// As after a gap: the camera is relocalized in the map.
TEST_P(TimeJumpTest, ForwardsGoesOnInTheMap) {
  set("on_time_jump", std::string(GetParam()));
  ASSERT_TRUE(load());
  drive(0, 4);
  stamp_ += ros::Duration(7200.0);
  const OdometryInfo found = confirmJump(3, 3 + kConfirmations);
  EXPECT_EQ(found.state, OdometryInfo::OK) << found.reason;
  EXPECT_EQ(found.relocalizations, 1U);
  const OdometryInfo info = drive(6, 8);
  EXPECT_EQ(info.state, OdometryInfo::OK) << info.reason;
  EXPECT_EQ(info.stamps_rejected, 0U);
  expectAt(synthetic::truePose(7), 0.03);
}

INSTANTIATE_TEST_SUITE_P(Policies, TimeJumpTest, ::testing::Values("reset", "keep_pose", "ignore"),
                         [](const auto& info) { return std::string(info.param); });

// --- Images that come again

TEST_F(NodeletFaultsTest, NamesImagesThatComeAgain) {
  ASSERT_TRUE(load());
  drive(0, 4);
  const OdometryInfo again = drive(3, 4);
  EXPECT_EQ(again.state, OdometryInfo::DEGRADED);
  EXPECT_EQ(again.reason, "repeated_images");
  expectAt(synthetic::truePose(4));
  EXPECT_TRUE(says("input", kWarn, "driver repeats them")) << said("input");
  EXPECT_EQ(counted("input", "frames with repeated images"), 1);
  EXPECT_EQ(drive(5, 7).state, OdometryInfo::OK);
  expectAt(synthetic::truePose(6));
}

// --- Exceptions

TEST_F(NodeletFaultsTest, CountsExceptionsAndGoesOnDegraded) {
  ASSERT_TRUE(load());
  drive(0, 4);
  stamp_ += ros::Duration(kPeriod_s);
  const Messages messages = makeMessages(4);
  {
    const FailingAllocator allocator(3);
    publish(messages);
    ASSERT_TRUE(waitFor([this] { return answered(); }));
    EXPECT_TRUE(allocator.hasFailed());
  }
  const OdometryInfo degraded = infoAt(stamp_);
  EXPECT_EQ(degraded.state, OdometryInfo::DEGRADED);
  EXPECT_EQ(degraded.reason, "exception");
  EXPECT_EQ(degraded.exceptions, 1U);
  EXPECT_TRUE(says("tracking", kError, "exception")) << said("tracking");
  expectAt(synthetic::truePose(4));
  EXPECT_EQ(drive(5, 7).state, OdometryInfo::OK);
  expectAt(synthetic::truePose(6));
}

}  // namespace
}  // namespace point_line_odometry

int main(int argc, char** argv) {
  ::testing::InitGoogleTest(&argc, argv);
  ros::init(argc, argv, "nodelet_faults_test");
  const ros::NodeHandle keep_running;
  return RUN_ALL_TESTS();
}
