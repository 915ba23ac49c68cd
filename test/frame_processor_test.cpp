/// The ROS layer around the core, without a node: parameters, frame processor, published messages.

#include "ros/frame_processor.h"

#include <gtest/gtest.h>
#include <sensor_msgs/point_cloud2_iterator.h>
#include <unistd.h>
#include <yaml-cpp/yaml.h>

#include <cmath>
#include <filesystem>
#include <opencv2/imgcodecs.hpp>
#include <string>

#include "common/input_error.h"
#include "ros/camera_messages.h"
#include "ros/conversions.h"
#include "ros/frame_messages.h"
#include "ros/parameter_loader.h"

namespace point_line_odometry {
namespace {

constexpr double kHalfPi = 1.57079632679489662;

/// Camera that looks along the base's x axis, 0.3 m ahead of its origin.
Eigen::Isometry3d mounting() {
  Eigen::Isometry3d T_base_camera = Eigen::Isometry3d::Identity();
  T_base_camera.linear() << 0, 0, 1, -1, 0, 0, 0, -1, 0;
  T_base_camera.translation() = Eigen::Vector3d(0.3, 0.0, 0.0);
  return T_base_camera;
}

/// A black pair at `stamp_s`: valid, but without features.
StereoMessages makeMessages(double stamp_s) {
  const auto image = boost::make_shared<sensor_msgs::Image>();
  image->header.stamp = ros::Time(stamp_s);
  image->header.frame_id = "/camera";
  image->encoding = "mono8";
  image->width = 320;
  image->height = 240;
  image->step = 320;
  image->data.assign(320 * 240, 0);
  const auto left = boost::make_shared<sensor_msgs::CameraInfo>();
  left->width = 320;
  left->height = 240;
  left->distortion_model = "plumb_bob";
  left->K = {300, 0, 160, 0, 300, 120, 0, 0, 1};
  left->R = {1, 0, 0, 0, 1, 0, 0, 0, 1};
  left->P = {300, 0, 160, 0, 0, 300, 120, 0, 0, 0, 1, 0};
  const auto right = boost::make_shared<sensor_msgs::CameraInfo>(*left);
  right->P[3] = -60.0;
  return {image, image, left, right};
}

AllParameters startAt(double x, double y) {
  AllParameters parameters;
  parameters.node.initial_pose.x = x;
  parameters.node.initial_pose.y = y;
  return parameters;
}

/// A processed frame with one inlier and one outlier of each kind.
ProcessedFrame makeFrame() {
  ProcessedFrame frame;
  frame.header.stamp = ros::Time(12.5);
  frame.header.frame_id = "camera";
  frame.T_base_camera = mounting();
  frame.left = cv::Mat(240, 320, CV_8UC1, cv::Scalar(42));
  frame.camera = {300, 300, 160, 120, 0.2, 320, 240};
  frame.result.state = TrackingState::kOk;
  frame.result.reason = TrackingReason::kNone;
  frame.result.T_odom_camera = mounting();
  ObservedPoint point;
  point.left_px = {100, 50};
  point.p_camera = {1, 2, 3};
  point.inlier = true;
  frame.result.points = {point, ObservedPoint()};
  ObservedLine line;
  line.start_camera = {0, 0, 2};
  line.end_camera = {1, 0, 2};
  line.inlier = true;
  frame.result.lines = {line, ObservedLine()};
  return frame;
}

std::string parseError(const XmlRpc::XmlRpcValue& tree) {
  try {
    parseParameters(tree);
  } catch (const std::runtime_error& error) {
    return error.what();
  }
  return "";
}

TEST(ParseParameters, SetsBothTables) {
  XmlRpc::XmlRpcValue tree;
  tree["base_frame_id"] = std::string("robot");
  tree["publish_tf"] = false;
  tree["initial_pose"]["yaw"] = kHalfPi;
  tree["lines"]["max_count"] = 123;
  tree["tracking"]["max_speed_m_s"] = 7;  // an integer for a double
  const AllParameters parameters = parseParameters(tree);
  EXPECT_EQ(parameters.node.base_frame_id, "robot");
  EXPECT_FALSE(parameters.node.publish_tf);
  EXPECT_EQ(parameters.core.lines.max_count, 123);
  EXPECT_EQ(parameters.core.tracking.max_speed_m_s, 7.0);
  const Eigen::Vector3d forward = initialPose(parameters.node).linear() * Eigen::Vector3d::UnitX();
  EXPECT_TRUE(forward.isApprox(Eigen::Vector3d::UnitY(), 1e-9));
}

TEST(ParseParameters, NamesEverythingThatIsWrong) {
  XmlRpc::XmlRpcValue tree;
  tree["no_such"]["name"] = 1;
  tree["another"] = 2;
  tree["queue_size"] = 0;
  tree["rectify"] = std::string("yes");
  tree["on_time_jump"] = std::string("panic");
  tree["motion"]["huber_delta"] = -1.0;
  const std::string error = parseError(tree);
  for (const char* name : {"~no_such/name", "~another", "queue_size is 0", "rectify must be true",
                           "on_time_jump is 'panic'", "motion/huber_delta is -1"}) {
    EXPECT_NE(error.find(name), std::string::npos) << name << " is not in: " << error;
  }
}

TEST(ParseParameters, RetiredOnesAreIgnoredWithAWarning) {
  XmlRpc::XmlRpcValue tree;
  tree["motion"]["max_iterations"] = 7;
  tree["window"]["max_iterations"] = std::string("many");
  tree["lines"]["max_count"] = 123;
  std::vector<std::string> warnings;
  EXPECT_EQ(parseParameters(tree, &warnings).core.lines.max_count, 123);
  ASSERT_EQ(warnings.size(), 2U);
  EXPECT_NE(warnings[0].find("motion/max_iterations"), std::string::npos) << warnings[0];
  EXPECT_NE(warnings[1].find("window/max_iterations"), std::string::npos) << warnings[1];
  tree["max_iterations"] = 7;  // never was one
  EXPECT_NE(parseError(tree).find("~max_iterations"), std::string::npos);
  EXPECT_EQ(parseError(tree).find("motion/"), std::string::npos);
}

TEST(ParseParameters, AcceptsParametersOfLibraries) {
  XmlRpc::XmlRpcValue tree;
  tree["num_worker_threads"] = 2;
  tree["compressed"]["mode"] = std::string("gray");
  tree["theora"]["post_processing_level"] = 1;
  tree["diagnostic_period"] = 2.0;
  EXPECT_EQ(parseError(tree), "");
  tree["new_transport"]["quality"] = 1;
  EXPECT_NE(parseError(tree).find("~new_transport/quality"), std::string::npos);
  tree["image_transport"] = std::string("new_transport");
  EXPECT_EQ(parseError(tree), "");
}

/// Compares each entry of a table with a YAML file.
struct YamlComparison {
  YAML::Node root;
  int entries = 0;

  template <typename T, typename... Rest>
  void operator()(const std::string& name, const T& value, const Rest&...) {
    ++entries;
    const std::size_t slash = name.find('/');
    const YAML::Node node = slash == std::string::npos
                                ? root[name]
                                : root[name.substr(0, slash)][name.substr(slash + 1)];
    ASSERT_TRUE(node.IsDefined()) << name;
    EXPECT_EQ(node.as<T>(), value) << name;
  }
};

TEST(ParseParameters, DefaultYamlNamesEveryParameterOfTheNodeWithItsDefault) {
  const std::string file = std::string(TEST_REPOSITORY_DIR) + "/config/default.yaml";
  YamlComparison comparison{YAML::LoadFile(file)};
  const NodeParameters defaults;
  visitNodeParameters(defaults, comparison);
  EXPECT_EQ(comparison.entries, static_cast<int>(nodeParameterNames().size()));
  EXPECT_NO_THROW(loadParameters(file, nodeParameterNames())) << "names that no table has";
}

TEST(FrameProcessor, BeginsAtTheInitialPoseOfTheBase) {
  FrameProcessor processor(startAt(1.0, 2.0));
  const ProcessedFrame frame = processor.process(makeMessages(10.0), mounting());
  EXPECT_EQ(frame.header.frame_id, "camera");
  EXPECT_TRUE(frame.T_odom_base().translation().isApprox(Eigen::Vector3d(1, 2, 0), 1e-9));
  EXPECT_TRUE(
      frame.result.T_odom_camera.isApprox(initialPose(startAt(1.0, 2.0).node) * mounting(), 1e-9));
}

TEST(FrameProcessor, RefusesMessagesAndGoesOn) {
  FrameProcessor processor{AllParameters()};
  StereoMessages bad = makeMessages(10.0);
  bad.right_info = bad.left_info;
  EXPECT_THROW(processor.process(bad, mounting()), MessageError);
  EXPECT_TRUE(processor.process(makeMessages(10.1), mounting()).result.accepted());
  const auto truncated = boost::make_shared<sensor_msgs::Image>(*makeMessages(10.2).left);
  truncated->data.resize(10);
  bad = makeMessages(10.2);
  bad.left = truncated;
  EXPECT_THROW(processor.process(bad, mounting()), MessageError);
  EXPECT_TRUE(processor.process(makeMessages(10.3), mounting()).result.accepted());
}

/// A pair of a camera with another baseline.
StereoMessages withBaseline(double baseline_m, double stamp_s) {
  StereoMessages messages = makeMessages(stamp_s);
  const auto right = boost::make_shared<sensor_msgs::CameraInfo>(*messages.right_info);
  right->P[3] = -300.0 * baseline_m;
  messages.right_info = right;
  return messages;
}

TEST(FrameProcessor, AcceptsAnotherCalibrationThatStaysAndKeepsThePose) {
  FrameProcessor processor(startAt(3.0, 0.0));
  processor.process(makeMessages(10.0), mounting());
  EXPECT_THROW(processor.process(withBaseline(0.3, 10.1), mounting()), MessageError);
  EXPECT_THROW(processor.process(withBaseline(0.3, 10.2), mounting()), MessageError);
  const ProcessedFrame frame = processor.process(withBaseline(0.3, 10.3), mounting());
  EXPECT_DOUBLE_EQ(frame.camera.baseline_m, 0.3);
  EXPECT_NEAR(frame.T_odom_base().translation().x(), 3.0, 1e-9);
}

TEST(FrameProcessor, AnotherCalibrationInAFewFramesChangesNothing) {
  FrameProcessor processor{AllParameters()};
  bool continues = false;
  processor.observeStarts([&](const FrameStart& start) { continues = start.continues; });
  processor.process(makeMessages(10.0), mounting());
  double stamp_s = 10.0;
  for (const double baseline_m : {0.3, 0.4, 0.3, 0.4, 0.3, 0.3}) {
    stamp_s += 0.1;
    EXPECT_THROW(processor.process(withBaseline(baseline_m, stamp_s), mounting()), MessageError);
  }
  EXPECT_DOUBLE_EQ(processor.process(makeMessages(10.9), mounting()).camera.baseline_m, 0.2);
  EXPECT_TRUE(continues);
  EXPECT_THROW(processor.process(withBaseline(0.3, 11.0), mounting()), MessageError);
  try {
    processor.process(withBaseline(0.3, 11.1), mounting());
  } catch (const MessageError& error) {
    EXPECT_EQ(
        std::string(error.what()),
        "right/camera_info: P is not as in the frames before; it is accepted once 3 frames in a "
        "row have it");
  }
}

/// The rectification maps of such a calibration would take 50 GB.
TEST(FrameProcessor, RefusesASizeOtherThanThatOfTheImagesBeforeItBuildsARectifier) {
  AllParameters parameters;
  parameters.node.rectify = true;
  FrameProcessor processor(parameters);
  StereoMessages messages = makeMessages(10.0);
  const auto left = boost::make_shared<sensor_msgs::CameraInfo>(*messages.left_info);
  left->width = left->height = 60000;
  const auto right = boost::make_shared<sensor_msgs::CameraInfo>(*left);
  right->P[3] = -60.0;
  messages.left_info = left;
  messages.right_info = right;
  EXPECT_THROW(processor.process(messages, mounting()), MessageError);
  EXPECT_TRUE(processor.process(makeMessages(10.1), mounting()).result.accepted());
}

/// A mask of 320 x 240 px whose left `columns` are ignored.
cv::Mat maskOf(int columns, cv::Size size = {320, 240}) {
  cv::Mat mask(size, CV_8UC1, cv::Scalar(255));
  mask.colRange(0, columns) = cv::Scalar(0);
  return mask;
}

/// A file in the folder for temporary files that is removed again.
class MaskFile {
 public:
  explicit MaskFile(const cv::Mat& image)
      : name_((std::filesystem::temp_directory_path() /
               ("point_line_mask_" + std::to_string(getpid()) + ".png"))
                  .string()) {
    cv::imwrite(name_, image);
  }
  ~MaskFile() { std::filesystem::remove(name_); }
  const std::string& name() const { return name_; }

 private:
  std::string name_;
};

TEST(FrameProcessor, IgnoresWhatAFileOrAMessageMasks) {
  const MaskFile file(maskOf(40));
  AllParameters parameters;
  parameters.node.left.mask = file.name();
  parameters.node.mask_images = "both";
  FrameProcessor processor(parameters);
  StereoMessages messages = makeMessages(10.0);
  cv::Mat below = maskOf(0);
  below.rowRange(120, 240) = cv::Scalar(0);
  messages.left_mask = toImageMessage(below, messages.left->header);
  messages.right_mask = messages.left_mask;
  const ProcessedFrame both = processor.process(messages, mounting());
  EXPECT_EQ(cv::countNonZero(both.masks.left), 280 * 120);
  EXPECT_EQ(cv::countNonZero(both.masks.right), 320 * 120);
  EXPECT_EQ(cv::countNonZero(both.left_mask), 280 * 120);
  EXPECT_EQ(both.masks.missing, 0);
  const ProcessedFrame file_only = processor.process(makeMessages(10.1), mounting());
  EXPECT_EQ(cv::countNonZero(file_only.masks.left), 280 * 240);
  EXPECT_TRUE(file_only.masks.right.empty());
  EXPECT_EQ(file_only.masks.missing, 2);
}

TEST(FrameProcessor, AMaskFileOfTheWrongSizeRejectsFramesWithItsName) {
  const MaskFile file(maskOf(40, {300, 240}));
  AllParameters parameters;
  parameters.node.right.mask = file.name();
  FrameProcessor processor(parameters);
  try {
    processor.process(makeMessages(10.0), mounting());
    ADD_FAILURE() << "the mask was taken";
  } catch (const MessageError& error) {
    const std::string text = error.what();
    for (const char* part : {"right mask '", file.name().c_str(), "300 x 240", "320 x 240"})
      EXPECT_NE(text.find(part), std::string::npos) << text;
  }
}

TEST(FrameProcessor, AMaskFileMustBeAnImageOfEightBit) {
  const MaskFile deep(cv::Mat(240, 320, CV_16UC1, cv::Scalar(1)));
  for (const std::string& name : {std::string("no_such_mask.png"), deep.name()}) {
    AllParameters parameters;
    parameters.node.left.mask = name;
    EXPECT_THROW(FrameProcessor{parameters}, InputError) << name;
  }
  const MaskFile colours(cv::Mat(240, 320, CV_8UC3, cv::Scalar(0, 0, 9)));
  AllParameters parameters;
  parameters.node.left.mask = colours.name();
  FrameProcessor processor(parameters);
  EXPECT_TRUE(processor.process(makeMessages(10.0), mounting()).result.accepted());
}

/// The frame is used without it.
TEST(FrameProcessor, AMaskMessageThatCannotBeUsedIsAsGoodAsNone) {
  AllParameters parameters;
  parameters.node.mask_images = "left";
  FrameProcessor processor(parameters);
  StereoMessages messages = makeMessages(10.0);
  messages.left_mask = toImageMessage(maskOf(10, {319, 240}), messages.left->header);
  ProcessedFrame frame = processor.process(messages, mounting());
  EXPECT_TRUE(frame.result.accepted());
  EXPECT_EQ(frame.masks.missing, 1);
  EXPECT_NE(frame.masks.fault.find("319 x 240"), std::string::npos) << frame.masks.fault;
  messages = makeMessages(10.1);
  const auto labels = toImageMessage(maskOf(10), messages.left->header);
  labels->encoding = "mono16";
  messages.left_mask = labels;
  frame = processor.process(messages, mounting());
  EXPECT_NE(frame.masks.fault.find("mono16"), std::string::npos) << frame.masks.fault;
  EXPECT_TRUE(frame.masks.left.empty());
}

TEST(FrameProcessor, FollowsThePolicyWhenTheClockJumpsBack) {
  for (const std::string policy : {"reset", "keep_pose", "ignore"}) {
    AllParameters parameters = startAt(1.0, 0.0);
    parameters.node.on_time_jump = policy;
    FrameProcessor processor(parameters);
    Eigen::Isometry3d elsewhere = Eigen::Isometry3d::Identity();
    elsewhere.translation().x() = 5.0;
    processor.process(makeMessages(20.0), mounting());
    processor.reset(elsewhere);
    processor.process(makeMessages(21.0), mounting());
    const ProcessedFrame frame = processor.process(makeMessages(10.0), mounting());
    EXPECT_EQ(frame.result.accepted(), policy != "ignore") << policy;
    EXPECT_EQ(processor.wasReset(), policy == "reset") << policy;
    EXPECT_NEAR(frame.T_odom_base().translation().x(), policy == "reset" ? 1.0 : 5.0, 1e-9)
        << policy;
  }
}

/// The pose is as uncertain afterwards as before, if not more.
TEST(FrameProcessor, KeepsTheCovarianceWhereItKeepsThePose) {
  AllParameters parameters;
  parameters.node.on_time_jump = "keep_pose";
  FrameProcessor processor(parameters);
  processor.process(makeMessages(20.0), mounting());
  const Matrix6d before = processor.process(makeMessages(20.1), mounting()).result.pose_covariance;
  ASSERT_GT(before.trace(), 0.0);
  const FrameResult set_back = processor.process(makeMessages(10.0), mounting()).result;
  EXPECT_EQ(set_back.reason, TrackingReason::kFirstFrame);
  EXPECT_GE(set_back.pose_covariance.trace(), before.trace());
  Eigen::Isometry3d moved = mounting();
  moved.translation().x() += 1.0;
  const ProcessedFrame elsewhere = processor.process(makeMessages(10.1), moved);
  EXPECT_EQ(elsewhere.result.reason, TrackingReason::kFirstFrame);
  EXPECT_GE(elsewhere.result.pose_covariance.trace(), set_back.pose_covariance.trace());
}

/// As from a computer whose clock is half a second behind.
TEST(FrameProcessor, CountsFramesForWhichTheSamplesGiveNothing) {
  AllParameters parameters;
  parameters.core.imu.enabled = true;
  FrameProcessor processor(parameters);
  const auto drive = [&](double from_s, double delay_s) {
    for (int k = 0; k < 5; ++k) {
      const double stamp_s = from_s + 0.1 * k;
      for (int i = -20; i <= 20; ++i) {
        ImuSample sample;
        sample.stamp_ns = std::llround(1e9 * (stamp_s - delay_s + 0.005 * i));
        processor.priorSources().addImu(sample, Eigen::Isometry3d::Identity());
      }
      processor.process(makeMessages(stamp_s), mounting());
    }
  };
  drive(20.0, 0.5);
  EXPECT_EQ(processor.priorSources().framesWithoutImu(), 4) << "all but the first";
  drive(20.5, 0.0);
  EXPECT_EQ(processor.priorSources().framesWithoutImu(), 0);
}

/// A bag that is played in a loop: its samples come before the first frame that tells of the jump.
TEST(FrameProcessor, KeepsTheSamplesOfAFrameWithWhichTheClockJumpsBack) {
  AllParameters parameters;
  parameters.core.imu.enabled = true;
  FrameProcessor processor(parameters);
  const auto drive = [&](double from_s) {
    std::vector<bool> with_prior;
    for (int k = 0; k < 3; ++k) {
      const double stamp_s = from_s + 0.1 * k;
      processor.announce(std::llround(1e9 * stamp_s));
      for (int i = k == 0 ? -20 : 1; i <= 20; ++i) {
        ImuSample sample;
        sample.stamp_ns = std::llround(1e9 * (stamp_s + 0.005 * i));
        processor.priorSources().addImu(sample, Eigen::Isometry3d::Identity());
      }
      with_prior.push_back(processor.process(makeMessages(stamp_s), mounting()).prior.has_value());
    }
    return with_prior;
  };
  const std::vector<bool> all_but_the_first{false, true, true};
  EXPECT_EQ(drive(20.0), all_but_the_first);
  EXPECT_EQ(drive(5.0), all_but_the_first) << "in the second round";
}

TEST(FrameProcessor, ALateFrameIsNoJumpOfTheClock) {
  for (const std::string policy : {"reset", "keep_pose", "ignore"}) {
    AllParameters parameters = startAt(1.0, 0.0);
    parameters.node.on_time_jump = policy;
    FrameProcessor processor(parameters);
    processor.process(makeMessages(20.0), mounting());
    processor.process(makeMessages(21.0), mounting());
    const ProcessedFrame late = processor.process(makeMessages(20.1), mounting());
    EXPECT_EQ(late.result.reason, TrackingReason::kStampNotNewer) << policy;
    EXPECT_FALSE(processor.wasReset()) << policy;
    EXPECT_EQ(processor.process(makeMessages(21.1), mounting()).result.accepted(), true) << policy;
  }
}

TEST(FrameProcessor, FeatureBudgetIsAShareOfTheParametersWithoutAReset) {
  FrameProcessor processor{AllParameters()};
  Parameters used;
  bool continues = false;
  processor.observeStarts([&](const FrameStart& start) {
    used = start.odometry.parameters();
    continues = start.continues;
  });
  EXPECT_EQ(processor.process(makeMessages(1.0), mounting()).feature_budget, 1.0);
  EXPECT_EQ(used.lines.max_count, 300);
  processor.setFeatureBudget({0.5, true});
  EXPECT_EQ(processor.process(makeMessages(1.1), mounting()).feature_budget, 0.5);
  EXPECT_EQ(used.lines.max_count, 150);
  EXPECT_EQ(used.points.max_per_cell, 10);
  EXPECT_EQ(used.tracking.landmark_frames, 1);
  EXPECT_TRUE(continues);
  Parameters core;
  core.lines.max_count = 100;
  processor.setParameters(core);
  processor.process(makeMessages(1.2), mounting());
  EXPECT_EQ(used.lines.max_count, 50) << "other parameters do not reset the budget";
  processor.setFeatureBudget({});
  processor.process(makeMessages(1.3), mounting());
  EXPECT_EQ(used.lines.max_count, 100);
  EXPECT_EQ(used.tracking.landmark_frames, 0);
}

TEST(FrameProcessor, InvertsTheRectifyingRotation) {
  AllParameters parameters;
  parameters.node.rectify = true;
  FrameProcessor processor(parameters);
  StereoMessages messages = makeMessages(10.0);
  const double tilt_rad = 0.01;
  const Eigen::Matrix3d R_rectified_raw =
      Eigen::AngleAxisd(tilt_rad, Eigen::Vector3d::UnitX()).toRotationMatrix();
  const auto left = boost::make_shared<sensor_msgs::CameraInfo>(*messages.left_info);
  Eigen::Map<Eigen::Matrix<double, 3, 3, Eigen::RowMajor>>(left->R.data()) = R_rectified_raw;
  messages.left_info = left;
  const ProcessedFrame frame = processor.process(messages, mounting());
  EXPECT_TRUE(frame.T_header_camera.linear().isApprox(R_rectified_raw.transpose(), 1e-9));
  EXPECT_TRUE(frame.T_base_camera.isApprox(mounting() * frame.T_header_camera, 1e-9));
  EXPECT_TRUE(frame.T_odom_base().isApprox(Eigen::Isometry3d::Identity(), 1e-9));
}

TEST(FrameMessages, OdometryIsThatOfTheBase) {
  ProcessedFrame frame = makeFrame();
  frame.result.T_odom_camera.translation().x() += 4.0;
  frame.result.twist << 0, 0, 2, 0, -0.5, 0;  // forward, turning to the left
  frame.result.pose_covariance(5, 5) = 0.01;
  const nav_msgs::Odometry odometry = toOdometry(frame, {"odom", "base_link"});
  EXPECT_EQ(odometry.header.stamp, frame.header.stamp);
  EXPECT_EQ(odometry.header.frame_id, "odom");
  EXPECT_EQ(odometry.child_frame_id, "base_link");
  EXPECT_NEAR(odometry.pose.pose.position.x, 4.0, 1e-9);
  EXPECT_NEAR(odometry.pose.pose.orientation.w, 1.0, 1e-9);
  EXPECT_NEAR(odometry.twist.twist.linear.x, 2.0, 1e-9);
  EXPECT_NEAR(odometry.twist.twist.linear.y, -0.3 * 0.5, 1e-9);
  EXPECT_NEAR(odometry.twist.twist.angular.z, 0.5, 1e-9);
  EXPECT_NEAR(odometry.pose.covariance[7], 0.3 * 0.3 * 0.01, 1e-9);
}

TEST(FrameMessages, TransformCanBeInverted) {
  ProcessedFrame frame = makeFrame();
  frame.result.T_odom_camera.translation().x() += 4.0;
  const auto forth = toTransformStamped(frame, {"odom", "base_link"}, false);
  EXPECT_EQ(forth.child_frame_id, "base_link");
  EXPECT_NEAR(forth.transform.translation.x, 4.0, 1e-9);
  const auto back = toTransformStamped(frame, {"odom", "base_link"}, true);
  EXPECT_EQ(back.header.frame_id, "base_link");
  EXPECT_EQ(back.child_frame_id, "odom");
  EXPECT_NEAR(back.transform.translation.x, -4.0, 1e-9);
}

TEST(FrameMessages, CloudHoldsTheInliers) {
  ProcessedFrame frame = makeFrame();
  frame.T_header_camera.linear() =
      Eigen::AngleAxisd(kHalfPi, Eigen::Vector3d::UnitZ()).toRotationMatrix();
  const sensor_msgs::PointCloud2 cloud = toPointCloud(frame);
  ASSERT_EQ(cloud.width * cloud.height, 1U);
  const sensor_msgs::PointCloud2ConstIterator<float> x(cloud, "x");
  EXPECT_NEAR(x[0], -2.0F, 1e-6F);
  EXPECT_NEAR(x[1], 1.0F, 1e-6F);
  EXPECT_NEAR(x[2], 3.0F, 1e-6F);
  EXPECT_EQ(*sensor_msgs::PointCloud2ConstIterator<float>(cloud, "intensity"), 42.0F);
}

TEST(FrameMessages, MarkersSeparateInliersFromOutliers) {
  ProcessedFrame frame = makeFrame();
  const auto markers = toLineMarkers(frame);
  ASSERT_EQ(markers.markers.size(), 2U);
  EXPECT_EQ(markers.markers[0].ns, "inliers");
  EXPECT_EQ(markers.markers[0].points.size(), 2U);
  EXPECT_EQ(markers.markers[0].header.frame_id, "camera");
  EXPECT_EQ(markers.markers[1].ns, "outliers");
  EXPECT_EQ(markers.markers[1].action, visualization_msgs::Marker::ADD);
  frame.result.lines.pop_back();
  EXPECT_EQ(toLineMarkers(frame).markers[1].action, visualization_msgs::Marker::DELETE);
}

TEST(FrameMessages, AccumulatedSegmentsAreNearInliersInOdom) {
  ProcessedFrame frame = makeFrame();
  ASSERT_EQ(toAccumulatedSegments(frame).size(), 1U);
  EXPECT_TRUE(toAccumulatedSegments(frame)[0].end.isApprox(Eigen::Vector3d(2.3, -1.0, 0.0), 1e-6));
  frame.result.lines[0].end_camera.z() = 1000.0F;
  EXPECT_TRUE(toAccumulatedSegments(frame).empty());
}

TEST(FrameMessages, FeaturesAndInfoHaveTheValuesOfTheResult) {
  ProcessedFrame frame = makeFrame();
  frame.result.counts.line_matches = 17;
  const StereoFeatures features = toFeatures(frame);
  ASSERT_EQ(features.points.size(), 2U);
  EXPECT_EQ(features.points[0].left_u, 100.0F);
  EXPECT_TRUE(features.points[0].inlier);
  EXPECT_FALSE(features.lines[1].inlier);
  const OdometryInfo info = toInfo(frame, {5, 1, 2, 3, 4, 6}, 8.0);
  EXPECT_EQ(info.state, OdometryInfo::OK);
  EXPECT_EQ(info.reason, "");
  EXPECT_EQ(info.line_matches, 17U);
  EXPECT_EQ(info.frames_processed, 5U);
  EXPECT_EQ(info.exceptions, 3U);
  EXPECT_EQ(info.stamps_rejected, 4U);
  EXPECT_EQ(info.relocalizations, 6U);
  EXPECT_EQ(info.stage_names.size(), info.stage_ms.size());
}

TEST(LatencyMs, IsZeroWhereTheClockHasAnotherTimeBase) {
  EXPECT_DOUBLE_EQ(latencyMs(ros::Time(10.0), ros::Time(10.5)), 500.0);
  EXPECT_EQ(latencyMs(ros::Time(10.0), ros::Time(9.0)), 0.0);
  EXPECT_EQ(latencyMs(ros::Time(10.0), ros::Time(1e9)), 0.0);
  EXPECT_EQ(latencyMs(ros::Time(4294967295U, 0), ros::Time(10.0)), 0.0);
}

}  // namespace
}  // namespace point_line_odometry
