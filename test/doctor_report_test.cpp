/// The lines of the start-up report: each is ok for a good input and fails for its faults.

#include "ros/doctor_report.h"

#include <gtest/gtest.h>
#include <tf2/buffer_core.h>

#include <cmath>
#include <limits>
#include <opencv2/imgproc.hpp>
#include <string>

#include "ros/calibration_conversion.h"
#include "ros/camera_messages.h"
#include "ros/doctor_checks.h"
#include "ros/doctor_rules.h"
#include "ros/image_conversion.h"
#include "ros/side_by_side.h"
#include "ros/stereo_input.h"
#include "world/synthetic_world.h"

namespace point_line_odometry {
namespace {

using Level = DoctorLevel;
using Subject = DoctorSubject;

constexpr double kPeriod_s = 0.1;

/// One stereo frame of the street, rendered once, and its calibration.
struct Street {
  StereoCalibration calibration;
  StereoImages images;
};

const Street& street() {
  static const Street instance = [] {
    const SyntheticWorld world{SyntheticWorldOptions()};
    return Street{world.calibration(), world.render(10)};
  }();
  return instance;
}

/// A stereo camera whose messages a test may change before the doctor receives them.
class Camera {
 public:
  Camera() {
    ros::Time::init();
    left_ = street().images.left.clone();
    right_ = street().images.right.clone();
    infos_ = {toCameraInfo(street().calibration.left, {}),
              toCameraInfo(street().calibration.right, {})};
    for (const auto& transform : toMountingTransforms(street().calibration, {}, ros::Time(1.0))) {
      tf_.setTransform(transform, "test", true);
    }
  }

  void addTransform(const std::string& parent, const std::string& child) {
    geometry_msgs::TransformStamped transform;
    transform.header.frame_id = parent;
    transform.child_frame_id = child;
    transform.transform.rotation.w = 1.0;
    tf_.setTransform(transform, "test", true);
  }

  /// Publishes `frames` frames and returns the facts of the checks.
  DoctorFacts watch(int frames = 10) {
    StereoInput::TopicNames names;
    for (std::size_t i = 0; i < kNumStereoTopics; ++i) {
      names[i] = "/stereo/" + stereoTopicName(static_cast<StereoTopic>(i), parameters_.rectify);
    }
    StereoMessages last;
    StereoInput input(parameters_, names, [&](const StereoMessages& set) { last = set; });
    for (int k = 1; k <= frames; ++k) publish(k, &input);
    DoctorChecks checks(parameters_);
    if (last.left) checks.measure(last);
    DoctorFacts facts = checks.facts(input.facts(frames * kPeriod_s + timeout_s_), tf_);
    facts.frame_ms = 20.0;
    return facts;
  }

  NodeParameters parameters_;
  cv::Mat left_;
  cv::Mat right_;
  std::array<sensor_msgs::CameraInfo, 2> infos_;
  std::string frame_ = "left_camera";
  std::string encoding_ = "mono8";
  std::array<bool, kNumStereoTopics> sent_{true, true, true, true};
  double right_delay_s_ = 0.0;
  double info_delay_s_ = 0.0;
  double timeout_s_ = 0.0;
  bool unstamped_ = false;
  tf2::BufferCore tf_;

 private:
  void publish(int k, StereoInput* input) const {
    const double time_s = k * kPeriod_s;
    const auto header = [&](double delay_s) {
      return makeHeader(frame_, unstamped_ ? ros::Time() : ros::Time(100.0 + time_s + delay_s));
    };
    const auto image = [&](StereoTopic topic, const cv::Mat& pixels, double delay_s) {
      if (!sent_[topic]) return;
      const sensor_msgs::ImagePtr message = toImageMessage(pixels, header(delay_s));
      message->encoding = encoding_;
      input->addImage(topic, message, time_s);
    };
    const auto info = [&](StereoTopic topic, double delay_s) {
      if (!sent_[topic]) return;
      auto message = boost::make_shared<sensor_msgs::CameraInfo>(infos_[topic - kLeftInfo]);
      message->header = header(delay_s + info_delay_s_);
      input->addInfo(topic, message, time_s);
    };
    image(kLeftImage, left_, 0.0);
    image(kRightImage, right_, right_delay_s_);
    info(kLeftInfo, 0.0);
    info(kRightInfo, right_delay_s_);
  }
};

DoctorLine lineOf(const std::vector<DoctorLine>& lines, Subject subject) {
  for (const DoctorLine& line : lines) {
    if (line.subject == subject) return line;
  }
  ADD_FAILURE() << "no line on " << toString(subject);
  return {};
}

bool contains(const std::string& text, const std::string& words) {
  return text.find(words) != std::string::npos;
}

/// The line on a subject has this level and these words, and a hint if it failed.
void expectLine(const DoctorFacts& facts, Subject subject, Level level, const std::string& words,
                const std::string& hint = "") {
  const DoctorLine line = lineOf(checkInput(facts), subject);
  EXPECT_EQ(line.level, level) << toString(subject) << ": " << line.text;
  EXPECT_TRUE(contains(line.text, words)) << line.text;
  EXPECT_TRUE(contains(line.hint, hint)) << line.hint;
  EXPECT_EQ(line.hint.empty(), !line.failed()) << line.text;
}

cv::Mat movedDown(const cv::Mat& image, double pixels) {
  const cv::Mat transform = (cv::Mat_<double>(2, 3) << 1, 0, 0, 0, 1, pixels);
  cv::Mat result;
  cv::warpAffine(image, result, transform, image.size(), cv::INTER_LINEAR, cv::BORDER_REFLECT);
  return result;
}

TEST(DoctorReportTest, EverythingIsWellWithAHealthyCamera) {
  Camera camera;
  const std::vector<DoctorLine> lines = checkInput(camera.watch());
  for (const DoctorLine& line : lines) {
    EXPECT_EQ(line.level, Level::kOk) << toString(line.subject) << ": " << line.text;
    EXPECT_TRUE(line.hint.empty());
    EXPECT_FALSE(line.text.empty());
  }
  EXPECT_EQ(lines.size(), 13U);
  EXPECT_EQ(summarize(lines), "all is well");
  EXPECT_EQ(worstLevel(lines), Level::kOk);
  EXPECT_TRUE(contains(lineOf(lines, Subject::kLeftImage).text, "10 messages, 10.0 Hz"));
  EXPECT_TRUE(contains(lineOf(lines, Subject::kStamps).text, "10 complete sets"));
  EXPECT_TRUE(contains(lineOf(lines, Subject::kImages).text, "1241 x 376 mono8"));
  EXPECT_TRUE(contains(lineOf(lines, Subject::kBaseline).text, "0.5"));
}

TEST(DoctorReportTest, NothingIsKnownBeforeAnythingComes) {
  Camera camera;
  const std::vector<DoctorLine> lines = checkInput(camera.watch(0));
  for (const Subject subject :
       {Subject::kLeftImage, Subject::kRightImage, Subject::kLeftInfo, Subject::kRightInfo}) {
    EXPECT_EQ(lineOf(lines, subject).level, Level::kError);
  }
  for (const Subject subject :
       {Subject::kStamps, Subject::kImages, Subject::kCalibration, Subject::kBaseline,
        Subject::kRectification, Subject::kDisparity, Subject::kMounting}) {
    EXPECT_EQ(lineOf(lines, subject).level, Level::kUnknown) << toString(subject);
  }
  EXPECT_EQ(summarize(lines), "4 errors, 8 not known yet");
}

TEST(DoctorReportTest, NamesAMissingTopicAndTheAvailableOnes) {
  for (const StereoTopic topic : {kLeftImage, kRightImage, kLeftInfo, kRightInfo}) {
    Camera camera;
    camera.sent_[topic] = false;
    DoctorFacts facts = camera.watch();
    const auto subject = static_cast<Subject>(topic);
    const std::string name = "/stereo/" + stereoTopicName(topic, false);
    expectLine(facts, subject, Level::kError, "nothing arrives on " + name, "remap");
    facts.input.topics[topic].publishers = 1;
    expectLine(facts, subject, Level::kError, name, "ROS_IP");
    facts.from_bag = true;
    expectLine(facts, subject, Level::kError, name, "--ns");
  }
  Camera camera;
  camera.sent_[kLeftImage] = false;
  DoctorFacts facts = camera.watch();
  facts.image_topics = {"/stereo/left/image_raw"};
  expectLine(facts, Subject::kLeftImage, Level::kError, "nothing", "set rectify to true");
  facts.image_topics = {"/stereo/left/image_rect/compressed"};
  expectLine(facts, Subject::kLeftImage, Level::kError, "nothing", "image_transport to compressed");
  facts.image_topics = {"/cam/image"};
  expectLine(facts, Subject::kLeftImage, Level::kError, "nothing", "images are on /cam/image");
}

TEST(DoctorReportTest, ReportsACameraThatHasStopped) {
  Camera camera;
  camera.timeout_s_ = 1.0;
  expectLine(camera.watch(), Subject::kRightImage, Level::kOk, "10.0 Hz");
  camera.timeout_s_ = 3.0;
  expectLine(camera.watch(), Subject::kRightImage, Level::kError, "nothing any more for 3.0 s",
             "restart");
}

TEST(DoctorReportTest, MeasuresTheSkewOfStamps) {
  Camera camera;
  camera.right_delay_s_ = 0.02;
  expectLine(camera.watch(), Subject::kStamps, Level::kError, "left and right images differ by 20",
             "approximate_sync to true");
  camera.parameters_.approximate_sync = true;
  camera.parameters_.approximate_sync_max_interval_s = 0.01;
  expectLine(camera.watch(), Subject::kStamps, Level::kError, "20.0 ms",
             "raise approximate_sync_max_interval_s");
  camera.parameters_.approximate_sync_max_interval_s = 0.03;
  expectLine(camera.watch(), Subject::kStamps, Level::kOk, "differ by 20.0 ms");

  Camera info_late;
  info_late.info_delay_s_ = 0.03;
  expectLine(info_late.watch(), Subject::kStamps, Level::kError, "images and camera_info differ",
             "same stamp");
  Camera unstamped;
  unstamped.unstamped_ = true;
  expectLine(unstamped.watch(), Subject::kStamps, Level::kError, "stamp 0", "time of exposure");
}

/// The rectification maps of such a calibration would take 50 GB.
TEST(DoctorReportTest, BuildsNoRectifierForASizeOtherThanThatOfTheImages) {
  Camera camera;
  camera.parameters_.rectify = true;
  for (sensor_msgs::CameraInfo& info : camera.infos_) info.width = info.height = 60000;
  EXPECT_FALSE(camera.watch().pair);
}

TEST(DoctorReportTest, NamesAnInvalidRawCalibration) {
  Camera camera;
  camera.parameters_.rectify = true;
  camera.infos_[0].K[0] = -1.0;
  expectLine(camera.watch(), Subject::kCalibration, Level::kError, "left camera: K");
}

TEST(DoctorReportTest, CountsPairsThatLackAMessage) {
  Camera camera;
  DoctorFacts facts = camera.watch(30);
  expectLine(facts, Subject::kStamps, Level::kOk, "30 complete sets");
  facts.input.sets = 15;
  expectLine(facts, Subject::kStamps, Level::kWarn, "15 of 30", "lost");
}

TEST(DoctorReportTest, RefusesImagesThatCannotBeUsed) {
  Camera bayer;
  bayer.encoding_ = "bayer_rggb8";
  expectLine(bayer.watch(), Subject::kImages, Level::kError, "bayer_rggb8", "debayer");
  Camera sizes;
  sizes.right_ = sizes.right_(cv::Rect(0, 0, 1000, 376)).clone();
  expectLine(sizes.watch(), Subject::kImages, Level::kError, "right ones 1000 x 376", "resolution");
  Camera half;
  cv::resize(half.left_, half.left_, cv::Size(620, 188));
  cv::resize(half.right_, half.right_, cv::Size(620, 188));
  expectLine(half.watch(), Subject::kImages, Level::kError, "camera_info describes 1241 x 376",
             "binning");
}

TEST(DoctorReportTest, ReportsABlankImage) {
  Camera camera;
  camera.right_ = cv::Mat(camera.right_.size(), CV_8UC1, cv::Scalar(3));
  const DoctorFacts facts = camera.watch();
  expectLine(facts, Subject::kImages, Level::kWarn, "right image has hardly any contrast", "lens");
  expectLine(facts, Subject::kRectification, Level::kUnknown, "not measured");
  expectLine(facts, Subject::kDisparity, Level::kUnknown, "not measured");
}

TEST(DoctorReportTest, WarnsOfUnequalExposure) {
  for (const double gain : {0.5, 0.6, 0.8, 1.0, 1.2, 1.6}) {
    Camera camera;
    camera.right_.convertTo(camera.right_, -1, gain);
    const double ratio = std::max(gain, 1.0 / gain);
    const bool is_unequal = ratio > 1.5;
    expectLine(camera.watch(), Subject::kImages, is_unequal ? Level::kWarn : Level::kOk,
               !is_unequal  ? "mono8"
               : gain < 1.0 ? "the left image is"
                            : "the right image is",
               is_unequal ? "auto-exposure" : "");
  }
}

TEST(DoctorReportTest, WarnsOfALensThatIsDirtyOrPartlyCovered) {
  for (const bool left : {true, false}) {
    for (const bool covered : {true, false}) {
      Camera camera;
      cv::Mat& image = left ? camera.left_ : camera.right_;
      cv::Mat part = image({image.cols / 3, image.rows / 3, image.cols / 3, image.rows / 2});
      if (covered) {
        part.setTo(20);
      } else {
        cv::GaussianBlur(part, part, {}, 12.0);
      }
      expectLine(camera.watch(), Subject::kImages, Level::kWarn,
                 left ? "the left image has less" : "the right image has less",
                 left ? "clean the left lens" : "clean the right lens");
    }
  }
}

TEST(DoctorReportTest, WarnsOfACalibrationOfAnotherResolution) {
  for (const double scale : {0.5, 0.8, 1.0, 1.2, 2.0}) {
    Camera camera;
    for (auto& info : camera.infos_) {
      for (const std::size_t i : {0U, 2U, 3U, 5U, 6U}) info.P[i] *= scale;
    }
    const bool is_of_other = scale < 0.6 || scale > 1.5;
    expectLine(camera.watch(), Subject::kCalibration, is_of_other ? Level::kWarn : Level::kOk,
               is_of_other ? "principal point" : "fx", is_of_other ? "resolution" : "");
  }
}

TEST(DoctorReportTest, ReportsOneCameraOnBothTopics) {
  Camera camera;
  camera.right_ = camera.left_;
  expectLine(camera.watch(), Subject::kImages, Level::kError, "are the same", "remapping");
}

TEST(DoctorReportTest, NamesTheFieldOfABadCalibration) {
  Camera zero;
  zero.infos_[1].P.fill(0.0);
  expectLine(zero.watch(), Subject::kCalibration, Level::kError, "right/camera_info: P is all zero",
             "calibrate");
  expectLine(zero.watch(), Subject::kBaseline, Level::kUnknown, "");
  Camera nan;
  nan.infos_[0].P[2] = std::numeric_limits<double>::quiet_NaN();
  expectLine(nan.watch(), Subject::kCalibration, Level::kError, "left/camera_info: P", "calibrate");
  Camera same;
  same.infos_[1] = same.infos_[0];
  expectLine(same.watch(), Subject::kCalibration, Level::kError, "P[3]", "check the remapping");
  Camera raw;
  raw.parameters_.rectify = true;
  raw.infos_[0].K.fill(0.0);
  expectLine(raw.watch(), Subject::kCalibration, Level::kError, "K", "");
}

TEST(DoctorReportTest, WarnsOfABaselineInMillimetres) {
  Camera camera;
  camera.infos_[1].P[3] *= 1000.0;
  expectLine(camera.watch(), Subject::kBaseline, Level::kWarn, "m, which hardly any pair has",
             "metres, not millimetres");
}

TEST(DoctorReportTest, MeasuresTheVerticalDisparityOfImagesThatAreNotRectified) {
  for (const double down_px : {2.0, 6.0, -30.0}) {
    Camera camera;
    camera.right_ = movedDown(camera.right_, down_px);
    const DoctorFacts facts = camera.watch();
    expectLine(facts, Subject::kRectification, Level::kWarn, "images are not rectified",
               "set rectify to true");
    ASSERT_TRUE(facts.pair);
    EXPECT_NEAR(facts.pair->row_offset_px, down_px, 0.3);
    std::array<char, 16> amount{};
    std::snprintf(amount.data(), amount.size(), "%.2f px", facts.pair->vertical_disparity_px);
    expectLine(facts, Subject::kRectification, Level::kWarn, amount.data());
    expectLine(facts, Subject::kDisparity, Level::kOk, "left camera is left");
  }
  Camera slightly;
  slightly.right_ = movedDown(slightly.right_, 1.0);
  expectLine(slightly.watch(), Subject::kRectification, Level::kOk, "1.0");
}

TEST(DoctorReportTest, ReportsImagesOfDifferentScenes) {
  Camera camera;
  cv::flip(camera.right_, camera.right_, 0);
  expectLine(camera.watch(), Subject::kRectification, Level::kWarn, "have no match in the right",
             "upside down");
  DoctorFacts plain_wall = camera.watch();
  plain_wall.pair->keypoints_right = 100;
  expectLine(plain_wall, Subject::kRectification, Level::kUnknown, "not measured");
}

TEST(DoctorReportTest, WarnsWhenTheRectificationDrifts) {
  Camera camera;
  DoctorFacts facts = camera.watch();
  facts.vertical_drift_px = 0.3;
  expectLine(facts, Subject::kRectification, Level::kOk, "matched points");
  facts.vertical_drift_px = -0.7;
  expectLine(facts, Subject::kRectification, Level::kWarn, "drifted by -0.70 px", "fasten");
}

TEST(DoctorReportTest, WarnsOfDisparitiesThatTheOdometryCorrects) {
  DoctorFacts facts = Camera().watch();
  ASSERT_TRUE(facts.camera);
  const double degree_px = M_PI / 180.0 * facts.camera->fx;
  facts.correction_px = Eigen::Vector2d(0.05 * degree_px, degree_px);
  expectLine(facts, Subject::kDisparity, Level::kOk, "left camera is left");
  facts.correction_px = Eigen::Vector2d(0.2 * degree_px, 0.1);
  expectLine(facts, Subject::kDisparity, Level::kWarn, "the odometry corrects disparities by",
             "calibrate");
  facts.pair.reset();
  expectLine(facts, Subject::kDisparity, Level::kWarn, "no pair of images measured yet; the");
}

TEST(DoctorReportTest, ReportsSwappedCameras) {
  Camera images;
  std::swap(images.left_, images.right_);
  expectLine(images.watch(), Subject::kDisparity, Level::kError, "are swapped", "exchange");
  expectLine(images.watch(), Subject::kRectification, Level::kOk, "");
  Camera all;
  std::swap(all.left_, all.right_);
  std::swap(all.infos_[0], all.infos_[1]);
  expectLine(all.watch(), Subject::kDisparity, Level::kError, "are swapped", "exchange");
  expectLine(all.watch(), Subject::kCalibration, Level::kError, "swapped", "exchange");
  DoctorFacts some = Camera().watch();
  some.pair->behind_infinity_share = 0.4;
  expectLine(some, Subject::kDisparity, Level::kWarn, "behind infinity", "calibrate");
}

/// What is seen of halves of one image that shows both cameras side by side, moved to the left in
/// it.
DoctorFacts watchSideBySide(int shift_px, bool swapped) {
  Camera camera;
  cv::Mat both;
  cv::hconcat(camera.left_, camera.right_, both);
  cv::Mat moved = both;
  if (shift_px > 0) {
    cv::hconcat(both.colRange(shift_px, both.cols), both.colRange(0, shift_px), moved);
  }
  const auto halves = cutInTwo(*toImageMessage(moved, makeHeader("usb_cam", ros::Time(1.0))));
  camera.left_ = toGray(*halves[swapped ? 1 : 0]).clone();
  camera.right_ = toGray(*halves[swapped ? 0 : 1]).clone();
  return camera.watch();
}

TEST(DoctorReportTest, ReportsTheWrongHalfOfASideBySideImage) {
  EXPECT_FALSE(watchSideBySide(0, false).seam_column);
  const DoctorFacts swapped = watchSideBySide(0, true);
  expectLine(swapped, Subject::kDisparity, Level::kError, "are swapped", "swap:=true");
  EXPECT_FALSE(swapped.seam_column);
  for (const int shift_px : {12, 100, 600}) {
    const DoctorFacts facts = watchSideBySide(shift_px, false);
    const std::string column = std::to_string(street().images.left.cols - shift_px);
    expectLine(facts, Subject::kImages, Level::kError,
               "column " + column + ": they are halves of a side-by-side image", "in the middle");
  }
}

TEST(DoctorReportTest, AsksForTheTransform) {
  Camera camera;
  camera.frame_ = "unknown_camera";
  DoctorFacts facts = camera.watch();
  expectLine(facts, Subject::kMounting, Level::kError, "no transform from base_link to unknown",
             "static_transform_publisher");
  facts.from_bag = true;
  expectLine(facts, Subject::kMounting, Level::kWarn, "in the bag", "static_transform_publisher");
  camera.parameters_.base_frame_id = "unknown_camera";
  expectLine(camera.watch(), Subject::kMounting, Level::kOk, "camera itself");
  camera.frame_ = "";
  expectLine(camera.watch(), Subject::kMounting, Level::kError, "frame_id", "optical frame");
  facts = Camera().watch();
  facts.T_base_camera = Eigen::Isometry3d::Identity();
  expectLine(facts, Subject::kMounting, Level::kWarn, "straight up", "-1.5708");
}

/// A frame has one parent in tf: it is the robot's topmost one that the odometry moves.
TEST(DoctorReportTest, AFrameBelowAnotherIsNoBase) {
  Camera camera;
  camera.frame_ = "optical_frame";
  tf2::BufferCore& tf = camera.tf_;
  camera.addTransform("base_link", "camera_link");
  camera.addTransform("camera_link", "optical_frame");
  EXPECT_EQ(topmostFrame(tf, "optical_frame", "odom"), "base_link");
  EXPECT_EQ(topmostFrame(tf, "unknown", "odom"), "unknown");
  camera.addTransform("visual_odom", "base_link");
  camera.addTransform("map", "visual_odom");
  EXPECT_EQ(topmostFrame(tf, "optical_frame", "visual_odom"), "base_link");
  camera.addTransform("map", "base_link");
  EXPECT_EQ(topmostFrame(tf, "optical_frame", "visual_odom"), "base_link");
  camera.parameters_.base_frame_id = "base_footprint";
  expectLine(camera.watch(), Subject::kMounting, Level::kError,
             "no transform from base_footprint to optical_frame",
             "from base_footprint to base_link, or set base_frame_id to base_link");
  camera.parameters_.base_frame_id = "optical_frame";
  DoctorFacts facts = camera.watch();
  addOtherParents({{"/robot_state_publisher", "camera_link"}}, tf, &facts);
  expectLine(facts, Subject::kMounting, Level::kError,
             "/robot_state_publisher publishes the pose of optical_frame in camera_link",
             "set base_frame_id to the topmost frame of the robot, base_link");
  facts.odometry_runs = false;
  addOtherParents({{"/wheels", "odom"}}, tf, &facts);
  expectLine(facts, Subject::kMounting, Level::kWarn, "/wheels publishes", "publish_tf: false");
}

TEST(DoctorReportTest, TellsWhatTheOdometryPublishesOnTf) {
  const auto text = [](const NodeParameters& parameters) {
    const std::optional<TfEdge> edge = transformOfOdometry(parameters);
    return edge ? edge->parent + " -> " + edge->child : "nothing";
  };
  NodeParameters parameters;
  EXPECT_EQ(text(parameters), "odom -> base_link");
  parameters.guess_frame_id = "wheel_odom";
  EXPECT_EQ(text(parameters), "odom -> wheel_odom");
  parameters.invert_tf = true;
  EXPECT_EQ(text(parameters), "wheel_odom -> odom");
  parameters.publish_tf = false;
  EXPECT_EQ(text(parameters), "nothing");
}

/// Configured, but absent.
TEST(DoctorReportTest, NamesSourcesOfWhichFramesHaveNothing) {
  DoctorFacts facts = Camera().watch();
  SourceFacts source;
  source.timeout = "no sample on /imu for a second: start what publishes it, or remap imu";
  facts.imu_source = facts.wheels_source = source;
  expectLine(facts, Subject::kImu, Level::kWarn, "no sample on /imu", "remap imu");
  expectLine(facts, Subject::kWheels, Level::kWarn, "no sample on /imu", "remap imu");
  facts.imu_source->counts = {200, 0, true};
  expectLine(facts, Subject::kImu, Level::kOk, "200 imu samples");
  facts.imu_source->frames_without = SourceFacts::kManyFrames;
  expectLine(facts, Subject::kImu, Level::kWarn, "too few of them", "compare both clocks");
}

TEST(DoctorReportTest, ComparesTheTimeOfAFrameWithTheRate) {
  DoctorFacts facts = Camera().watch();
  expectLine(facts, Subject::kSpeed, Level::kOk, "20.0 ms per frame, one comes every 100.0 ms");
  facts.frame_ms = 130.0;
  expectLine(facts, Subject::kSpeed, Level::kWarn, "130.0 ms", "points/max_per_cell");
  facts.frame_ms.reset();
  expectLine(facts, Subject::kSpeed, Level::kUnknown, "");
}

ProcessedFrame maskedFrame(double inliers_near_rim) {
  ProcessedFrame frame;
  frame.left_mask = cv::Mat(100, 400, CV_8UC1, cv::Scalar(255));
  frame.left_mask.colRange(0, 100) = cv::Scalar(0);
  frame.masks.left = frame.left_mask;
  for (int i = 0; i < 200; ++i) {
    ObservedPoint point;
    point.left_px = {i % 2 == 0 ? 110.0F : 300.0F, 50.0F};
    point.inlier = i % 2 == 1 || i < 200 * inliers_near_rim;
    frame.result.points.push_back(point);
  }
  return frame;
}

TEST(DoctorReportTest, ReportsOnMasksWhereThereAreSome) {
  Camera camera;
  DoctorFacts facts = camera.watch();
  facts.masks.emplace();
  for (const DoctorLine& line : checkInput(facts)) EXPECT_NE(line.subject, Subject::kMasks);
  camera.parameters_.left.mask = "no_such_mask.png";
  expectLine(camera.watch(), Subject::kMasks, Level::kError, "no_such_mask.png", "PNG");
  facts.masks.reset();
  facts.parameters.left.mask = "bonnet.png";
  expectLine(facts, Subject::kMasks, Level::kUnknown, "no frame");
  const auto masksOf = [](const ProcessedFrame& frame) {
    MaskFacts masks;
    for (int i = 0; i < 4; ++i) masks.add(frame);
    return masks;
  };
  facts.masks = masksOf(maskedFrame(1.0));
  expectLine(facts, Subject::kMasks, Level::kOk, "25 % of the left and 0 % of the right");
  facts.masks = masksOf(maskedFrame(0.5));
  expectLine(facts, Subject::kMasks, Level::kWarn, "near its rim only 50 %", "enlarge the mask");
  ProcessedFrame all = maskedFrame(1.0);
  all.masks.left = cv::Mat(100, 400, CV_8UC1, cv::Scalar(0));
  facts.masks = masksOf(all);
  expectLine(facts, Subject::kMasks, Level::kWarn, "100 % of the left", "0, all others");
}

TEST(DoctorReportTest, WarnsOfMasksThatAreMissingOrUnusable) {
  Camera camera;
  camera.parameters_.mask_images = "both";
  DoctorFacts facts = camera.watch();
  facts.masks.emplace();
  facts.masks->frames = 10;
  facts.masks->missing = 1;
  expectLine(facts, Subject::kMasks, Level::kOk, "0 % of the left");
  facts.masks->missing = 7;
  expectLine(facts, Subject::kMasks, Level::kWarn, "7 of 20 masks", "mask_wait_s");
  facts.masks->fault = "left mask: it is 3 x 3";
  expectLine(facts, Subject::kMasks, Level::kWarn, "left mask: it is 3 x 3", "mono8");
}

TEST(DoctorReportTest, ReportsAMissingClock) {
  DoctorFacts facts = Camera().watch();
  facts.clock_missing = true;
  expectLine(facts, Subject::kClock, Level::kError, "use_sim_time", "--clock");
  Camera unstamped;
  unstamped.unstamped_ = true;
  facts = unstamped.watch();
  facts.clock_missing = true;
  expectLine(facts, Subject::kStamps, Level::kError, "use_sim_time", "/use_sim_time false");
}

TEST(DoctorReportTest, MeasuresRawImagesAfterRectification) {
  SyntheticWorldOptions options;
  options.scene = "corridor";
  const SyntheticWorld world(options);
  const StereoImages images = world.render(20);
  Camera camera;
  camera.left_ = images.left;
  camera.right_ = images.right;
  camera.infos_ = {toCameraInfo(world.calibration().left, {}),
                   toCameraInfo(world.calibration().right, {})};
  expectLine(camera.watch(), Subject::kRectification, Level::kWarn, "not rectified", "rectify");
  camera.parameters_.rectify = true;
  expectLine(camera.watch(), Subject::kRectification, Level::kOk, "matched points");
}

TEST(DoctorReportTest, BecomesMessagesAndText) {
  Camera camera;
  camera.frame_ = "unknown_camera";
  const std::vector<DoctorLine> lines = checkInput(camera.watch());
  const auto array = toDiagnosticArray(lines, "odometry", ros::Time(5.0));
  ASSERT_EQ(array.status.size(), lines.size());
  int errors = 0;
  for (const auto& status : array.status) {
    EXPECT_EQ(status.name.rfind("odometry: ", 0), 0U) << status.name;
    if (status.level != diagnostic_msgs::DiagnosticStatus::ERROR) continue;
    ++errors;
    EXPECT_EQ(status.name, "odometry: tf");
    ASSERT_FALSE(status.values.empty());
    EXPECT_EQ(status.values[0].key, "hint");
    EXPECT_TRUE(contains(status.message, status.values[0].value));
  }
  EXPECT_EQ(errors, 1);
  const std::string text = formatReport(lines);
  EXPECT_TRUE(contains(text, "ERROR  tf "));
  EXPECT_TRUE(contains(text, "-> publish it"));
}

/// What consecutive pairs have told, as one line of the report.
DoctorLine sequenceLine(Subject subject, const SequenceMeasurement& sequence) {
  DoctorFacts facts = Camera().watch();
  facts.sequence = sequence;
  for (const DoctorLine& line : checkInput(facts)) {
    if (line.subject == subject) return line;
  }
  ADD_FAILURE() << "no line on " << toString(subject);
  return {};
}

TEST(SequenceLines, SayWhichImagesAreLateAndByHowMuch) {
  SequenceMeasurement sequence;
  EXPECT_EQ(sequenceLine(Subject::kTrigger, sequence).level, Level::kUnknown);
  sequence.frames = 30;
  EXPECT_NE(sequenceLine(Subject::kTrigger, sequence).text.find("not checked"), std::string::npos);
  sequence.delay_s = 0.010;
  sequence.delay_sigma_s = 0.0001;
  sequence.speed_px_s = 100.0;
  DoctorLine line = sequenceLine(Subject::kTrigger, sequence);
  EXPECT_EQ(line.level, Level::kWarn);
  EXPECT_NE(line.text.find("10.0 ms after the left"), std::string::npos) << line.text;
  sequence.delay_s = -0.010;
  line = sequenceLine(Subject::kTrigger, sequence);
  EXPECT_EQ(line.level, Level::kWarn);
  EXPECT_NE(line.text.find("10.0 ms before the left"), std::string::npos) << line.text;
  sequence.delay_sigma_s = 0.004;
  line = sequenceLine(Subject::kTrigger, sequence);
  EXPECT_EQ(line.level, Level::kOk) << "not certain";
  EXPECT_NE(line.text.find("not checked"), std::string::npos) << line.text;
  sequence.delay_sigma_s = 0.0001;
  sequence.speed_px_s = 10.0;
  EXPECT_EQ(sequenceLine(Subject::kTrigger, sequence).level, Level::kOk) << "it does no harm";
  sequence.speed_px_s = 1000.0;
  sequence.delay_s = 0.0007;
  line = sequenceLine(Subject::kTrigger, sequence);
  EXPECT_EQ(line.level, Level::kOk) << "as cameras with a common trigger may have";
  EXPECT_NE(line.text.find("at the same time"), std::string::npos) << line.text;
}

TEST(SequenceLines, CountImagesThatComeAgain) {
  SequenceMeasurement sequence;
  sequence.pairs = 30;
  EXPECT_EQ(sequenceLine(Subject::kImages, sequence).level, Level::kOk);
  sequence.repeated_right = 5;
  const DoctorLine line = sequenceLine(Subject::kImages, sequence);
  EXPECT_EQ(line.level, Level::kWarn);
  EXPECT_TRUE(contains(line.text, "0 left and 5 right images of 30 pairs")) << line.text;
  EXPECT_TRUE(contains(line.hint, "driver")) << line.hint;
}

TEST(SequenceLines, TellStampsOfTheArrival) {
  SequenceMeasurement sequence;
  sequence.frames = 60;
  sequence.bursts = 2;
  EXPECT_EQ(sequenceLine(Subject::kStamps, sequence).level, Level::kOk);
  sequence.bursts = 8;
  const DoctorLine line = sequenceLine(Subject::kStamps, sequence);
  EXPECT_EQ(line.level, Level::kWarn);
  EXPECT_TRUE(contains(line.text, "8 of 60 pairs")) << line.text;
  EXPECT_TRUE(contains(line.hint, "exposure")) << line.hint;
}

TEST(SequenceLines, WarnOfARollingShutter) {
  SequenceMeasurement sequence;
  EXPECT_EQ(sequenceLine(Subject::kShutter, sequence).level, Level::kUnknown);
  sequence.frames = 30;
  sequence.period_s = 0.05;
  sequence.speed_px_s = 200.0;
  EXPECT_TRUE(contains(sequenceLine(Subject::kShutter, sequence).text, "not checked"));
  sequence.read_out_s = 0.020;
  sequence.read_out_sigma_s = 0.002;
  DoctorLine line = sequenceLine(Subject::kShutter, sequence);
  EXPECT_EQ(line.level, Level::kWarn);
  EXPECT_TRUE(contains(line.text, "the last one 20.0 ms after the first (+- 2.0 ms")) << line.text;
  EXPECT_TRUE(contains(line.hint, "tracking/rolling_shutter_ms to 20.0 unless")) << line.hint;
  sequence.read_out_s = -0.020;
  line = sequenceLine(Subject::kShutter, sequence);
  EXPECT_TRUE(contains(line.text, "the first one 20.0 ms after the last")) << line.text;
  EXPECT_TRUE(contains(line.hint, "tracking/rolling_shutter_ms to -20.0 unless")) << line.hint;
  sequence.read_out_sigma_s = 0.006;
  line = sequenceLine(Subject::kShutter, sequence);
  EXPECT_EQ(line.level, Level::kOk) << "not certain";
  EXPECT_TRUE(contains(line.text, "not checked")) << line.text;
  sequence.read_out_s = 0.004;
  sequence.read_out_sigma_s = 0.0002;
  line = sequenceLine(Subject::kShutter, sequence);
  EXPECT_EQ(line.level, Level::kOk) << "less than a tenth of the period";
  EXPECT_TRUE(contains(line.text, "at the same time, within 4.6 ms from first to last"))
      << line.text;
  sequence.read_out_s = 0.020;
  sequence.speed_px_s = 10.0;
  EXPECT_EQ(sequenceLine(Subject::kShutter, sequence).level, Level::kOk) << "it does no harm";
}

TEST(SequenceLines, WarnOfAPatternAllOverTheImage) {
  SequenceMeasurement sequence;
  EXPECT_EQ(sequenceLine(Subject::kProjector, sequence).level, Level::kUnknown);
  sequence.frames = 30;
  EXPECT_NE(sequenceLine(Subject::kProjector, sequence).text.find("not checked"),
            std::string::npos);
  sequence.pattern.compared = 1000;
  sequence.pattern.resting = 5;
  sequence.pattern.cells = 1;
  EXPECT_EQ(sequenceLine(Subject::kProjector, sequence).level, Level::kOk);
  sequence.pattern.resting = 100;
  EXPECT_EQ(sequenceLine(Subject::kProjector, sequence).level, Level::kOk) << "dirt on the lens";
  sequence.pattern.cells = 10;
  const DoctorLine line = sequenceLine(Subject::kProjector, sequence);
  EXPECT_EQ(line.level, Level::kWarn);
  EXPECT_NE(line.text.find("100 of 1000 points"), std::string::npos) << line.text;
}

TEST(PairTrendTest, ReturnsMediansAndTheDrift) {
  PairTrend trend;
  EXPECT_FALSE(trend.current());
  PairMeasurement measurement;
  measurement.matches = 100;
  for (const double offset_px : {0.1, 0.2, 9.0, 0.1, 0.2}) {
    EXPECT_FALSE(trend.verticalDrift_px());
    measurement.row_offset_px = offset_px;
    trend.add(measurement);
  }
  EXPECT_DOUBLE_EQ(trend.current()->row_offset_px, 0.2) << "one outlier of five does not count";
  EXPECT_DOUBLE_EQ(trend.verticalDrift_px().value(), 0.0);
  for (int i = 0; i < 100; ++i) {
    measurement.row_offset_px = 1.0;
    trend.add(measurement);
  }
  EXPECT_DOUBLE_EQ(trend.verticalDrift_px().value(), 0.8);
  trend.add(PairMeasurement());
  EXPECT_FALSE(trend.current()->valid())
      << "the latest measurement, which has no matches, is returned itself";
  EXPECT_DOUBLE_EQ(trend.verticalDrift_px().value(), 0.8);
}

TEST(PairTrendTest, IsResetByAnotherCalibration) {
  const auto set = [](const sensor_msgs::CameraInfo& right_info) {
    return StereoMessages{
        toImageMessage(street().images.left, {}), toImageMessage(street().images.right, {}),
        boost::make_shared<sensor_msgs::CameraInfo>(toCameraInfo(street().calibration.left, {})),
        boost::make_shared<sensor_msgs::CameraInfo>(right_info)};
  };
  const sensor_msgs::CameraInfo info = toCameraInfo(street().calibration.right, {});
  sensor_msgs::CameraInfo other = info;
  other.P[3] *= 1.1;
  DoctorChecks checks((NodeParameters()));
  const tf2::BufferCore tf;
  for (std::size_t i = 0; i < PairTrend::kWindow; ++i) checks.measure(set(info));
  EXPECT_TRUE(checks.facts(InputFacts(), tf).vertical_drift_px);
  checks.measure(set(other));
  EXPECT_TRUE(checks.facts(InputFacts(), tf).vertical_drift_px) << "one bad message";
  EXPECT_EQ(checks.facts(InputFacts(), tf).calibration_change, "right/camera_info: P");
  for (int i = 1; i < kConfirmations; ++i) checks.measure(set(other));
  EXPECT_FALSE(checks.facts(InputFacts(), tf).vertical_drift_px);
}

std::vector<DoctorLine> linesOf(Level level) {
  DoctorLine line;
  line.level = level;
  return {line, DoctorLine()};
}

TEST(ReportScheduleTest, ReportsOnceAfterTwoSecondsWhenAllIsWell) {
  ReportSchedule schedule;
  EXPECT_FALSE(schedule.due(1.9, linesOf(Level::kOk)));
  EXPECT_TRUE(schedule.due(2.0, linesOf(Level::kOk)));
  for (double age_s = 3.0; age_s < 1000.0; age_s += 1.0) {
    EXPECT_FALSE(schedule.due(age_s, linesOf(Level::kError)))
        << "later changes are left to the diagnostics";
  }
}

TEST(ReportScheduleTest, ReportsAgainWhenMoreIsKnown) {
  ReportSchedule schedule;
  EXPECT_TRUE(schedule.due(2.0, linesOf(Level::kError)));
  for (double age_s = 3.0; age_s < 100.0; age_s += 1.0) {
    EXPECT_FALSE(schedule.due(age_s, linesOf(Level::kError))) << "nothing has changed";
  }
  EXPECT_TRUE(schedule.due(100.0, linesOf(Level::kWarn)));
  EXPECT_FALSE(schedule.due(103.9, linesOf(Level::kOk))) << "too soon";
  EXPECT_TRUE(schedule.due(104.0, linesOf(Level::kOk)));
}

TEST(ReportScheduleTest, IsBounded) {
  ReportSchedule schedule;
  int reports = 0;
  for (int second = 0; second < 100000; ++second) {
    if (schedule.due(second, linesOf(second % 2 == 0 ? Level::kError : Level::kWarn))) ++reports;
  }
  EXPECT_EQ(reports, ReportSchedule::kMostReports);
}

}  // namespace
}  // namespace point_line_odometry
