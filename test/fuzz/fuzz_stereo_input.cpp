/// Sequences of messages through the nodelet's input: StereoInput, SensorMounting and
/// FrameProcessor, connected as in the nodelet.

#include <ros/time.h>
#include <tf2/buffer_core.h>

#include <algorithm>
#include <array>
#include <boost/make_shared.hpp>
#include <cmath>
#include <cstring>
#include <exception>
#include <string>
#include <vector>

#include "fuzz/fuzz_support.h"
#include "fuzz/fuzz_targets.h"
#include "ros/calibration_conversion.h"
#include "ros/conversions.h"
#include "ros/frame_messages.h"
#include "ros/frame_processor.h"
#include "ros/sensor_mounting.h"
#include "ros/stereo_input.h"

namespace point_line_odometry {
namespace {

constexpr std::uint32_t kWidth = 32;
constexpr std::uint32_t kHeight = 24;
constexpr std::size_t kMaxPixelBytes = 1U << 16U;  // more only makes the fuzzer slow
constexpr int kMaxFrames = 30;
constexpr std::int64_t kPeriod_ns = 50000000;
constexpr std::int64_t kBegin_ns = 1000000000000;
constexpr double kArrivalPeriod_s = 0.05;

/// Reads values from the front of the bytes, zeros after their end.
class ByteReader {
 public:
  ByteReader(const std::uint8_t* data, std::size_t size) : data_(data), size_(size) {}

  bool empty() const { return size_ == 0; }

  template <typename Value>
  Value take() {
    Value value{};
    const std::size_t bytes = std::min(sizeof(value), size_);
    std::memcpy(&value, data_, bytes);
    data_ += bytes;
    size_ -= bytes;
    return value;
  }

  std::string takeText() {
    const std::size_t length = std::min<std::size_t>(take<std::uint8_t>() % 16, size_);
    std::string text = toText(data_, length);
    data_ += length;
    size_ -= length;
    return text;
  }

 private:
  const std::uint8_t* data_;
  std::size_t size_;
};

/// The messages of a frame, in the order of StereoTopic.
struct Frame {
  std::array<sensor_msgs::Image, 2> images;
  std::array<sensor_msgs::CameraInfo, 2> infos;
  std::array<bool, kNumStereoTopics> sent{true, true, true, true};

  std_msgs::Header& header(std::size_t topic) {
    return topic < kLeftInfo ? images[topic].header : infos[topic - kLeftInfo].header;
  }
};

/// A uniform pair without motion, so that the pose must not change.
Frame plainFrame(std::int64_t stamp_ns) {
  Frame frame;
  for (sensor_msgs::Image& image : frame.images) {
    image.encoding = "mono8";
    image.width = image.step = kWidth;
    image.height = kHeight;
    image.data.assign(kWidth * kHeight, 90);
  }
  for (sensor_msgs::CameraInfo& info : frame.infos) {
    info.width = kWidth;
    info.height = kHeight;
    info.distortion_model = "plumb_bob";
    info.D.assign(5, 0.0);
    info.K = {40, 0, 16, 0, 40, 12, 0, 0, 1};
    info.R = {1, 0, 0, 0, 1, 0, 0, 0, 1};
    info.P = {40, 0, 16, 0, 0, 40, 12, 0, 0, 0, 1, 0};
  }
  frame.infos[1].P[3] = -8.0;
  for (std::size_t topic = 0; topic < kNumStereoTopics; ++topic) {
    frame.header(topic).stamp.fromNSec(static_cast<std::uint64_t>(stamp_ns));
    frame.header(topic).frame_id = "camera";
  }
  return frame;
}

ros::Time takeStamp(ByteReader* bytes) {
  ros::Time stamp;  // as in a deserialised message: not normalised
  stamp.sec = bytes->take<std::uint32_t>();
  stamp.nsec = bytes->take<std::uint32_t>();
  return stamp;
}

void spoilImage(ByteReader* bytes, sensor_msgs::Image* image) {
  switch (bytes->take<std::uint8_t>() % 5) {
    case 0:
      image->width = bytes->take<std::uint32_t>();
      break;
    case 1:
      image->height = bytes->take<std::uint32_t>();
      break;
    case 2:
      image->step = bytes->take<std::uint32_t>();
      break;
    case 3:
      image->encoding = bytes->takeText();
      break;
    default:
      image->data.resize(bytes->take<std::uint32_t>() % kMaxPixelBytes);
      break;
  }
}

void spoilInfo(ByteReader* bytes, sensor_msgs::CameraInfo* info) {
  const std::array<std::uint32_t*, 8> numbers{
      &info->width,        &info->height,       &info->binning_x, &info->binning_y,
      &info->roi.x_offset, &info->roi.y_offset, &info->roi.width, &info->roi.height};
  const std::uint8_t field = bytes->take<std::uint8_t>() % 13;
  if (field < numbers.size()) {
    *numbers[field] = bytes->take<std::uint32_t>();
  } else if (field == 8) {
    info->distortion_model = bytes->takeText();
  } else if (field == 9) {
    info->D.resize(bytes->take<std::uint8_t>() % 16);
    std::fill(info->D.begin(), info->D.end(), bytes->take<double>());
  } else {
    const std::uint8_t index = bytes->take<std::uint8_t>();
    if (field == 10) info->K[index % 9] = bytes->take<double>();
    if (field == 11) info->R[index % 9] = bytes->take<double>();
    if (field == 12) info->P[index % 12] = bytes->take<double>();
  }
}

/// The next frame at the time of `clock_ns`, which a jump of the clock changes permanently.
Frame takeFrame(ByteReader* bytes, std::int64_t* clock_ns) {
  const std::uint8_t kind = bytes->take<std::uint8_t>();
  const std::size_t topic = (kind >> 4U) % kNumStereoTopics;
  if (kind % 10 == 1) *clock_ns = toNanoseconds(takeStamp(bytes));
  if (kind % 10 == 2) *clock_ns += 1000000LL * bytes->take<std::int32_t>();
  *clock_ns = std::clamp<std::int64_t>(*clock_ns + kPeriod_ns, 0, toNanoseconds(ros::TIME_MAX));
  Frame frame = plainFrame(*clock_ns);
  switch (kind % 10) {
    case 3: {
      const ros::Time stamp = takeStamp(bytes);
      for (std::size_t i = 0; i < kNumStereoTopics; ++i) frame.header(i).stamp = stamp;
      break;
    }
    case 4:
      frame.header(topic).stamp = takeStamp(bytes);
      break;
    case 5:
      frame.header(topic).frame_id = bytes->takeText();
      break;
    case 6:
      spoilImage(bytes, &frame.images[topic % 2]);
      break;
    case 7:
      spoilInfo(bytes, &frame.infos[topic % 2]);
      break;
    case 8: {
      ByteReader same = *bytes;
      spoilInfo(bytes, frame.infos.data());
      spoilInfo(&same, &frame.infos[1]);
      break;
    }
    case 9:
      frame.sent[topic] = false;
      break;
    default:
      break;
  }
  return frame;
}

/// The nodelet's processing of messages, with checks of its guarantees.
class Pipeline {
 public:
  Pipeline(const AllParameters& parameters, const Eigen::Isometry3d& T_odom_base)
      : initial_pose_(initialPose(parameters.node)),
        T_odom_base_(T_odom_base),
        input_(parameters.node, {"left", "right", "left_info", "right_info"},
               [this](const StereoMessages& set) { takeSafely(set); }),
        mounting_("left image", knownFrame),
        processor_(parameters) {
    processor_.reset(T_odom_base);
    processor_.observeStarts([this](const FrameStart& start) { continues_ = start.continues; });
  }

  void publish(Frame frame, double arrival_s) {
    if (frame.sent[kLeftImage]) left_stamps_.push_back(frame.header(kLeftImage).stamp);
    for (const StereoTopic topic : {kLeftImage, kRightImage}) {
      if (!frame.sent[topic]) continue;
      input_.addImage(topic, boost::make_shared<const sensor_msgs::Image>(frame.images[topic]),
                      arrival_s);
    }
    for (const StereoTopic topic : {kLeftInfo, kRightInfo}) {
      if (!frame.sent[topic]) continue;
      const auto info =
          boost::make_shared<const sensor_msgs::CameraInfo>(frame.infos[topic - kLeftInfo]);
      input_.addInfo(topic, info, arrival_s);
    }
    if (broken_) std::rethrow_exception(broken_);
    input_.facts(arrival_s);
    input_.explainTimeout();
  }

 private:
  static Eigen::Isometry3d knownFrame(const std::string& camera) {
    if (camera != "camera" && camera != "c") throw std::runtime_error("not known to tf");
    Eigen::Isometry3d T_base_camera = Eigen::Isometry3d::Identity();
    if (camera == "c") T_base_camera.translation().x() = 0.5;
    return T_base_camera;
  }

  /// StereoInput catches all exceptions, so they are kept for publish().
  void takeSafely(const StereoMessages& set) {
    try {
      take(set);
    } catch (const MessageError&) {
      // a frame that is rejected
    } catch (...) {
      broken_ = std::current_exception();
    }
  }

  void take(const StereoMessages& set) {
    const std::string& frame_id = set.left->header.frame_id;
    try {
      mounting_.prepare(frame_id);
    } catch (const std::runtime_error&) {
      return;  // it would wait for tf, and be dropped in the end
    }
    sets_of_mounting_.push_back(set);
    const Eigen::Isometry3d T_base_header = mounting_.take(frame_id);
    sets_.push_back(set);
    const ProcessedFrame frame = processor_.process(set, T_base_header);
    if (!frame.result.accepted()) return;
    checkStart(set);
    checkPose(frame);
    checkMessages(frame);
    last_ = set;
  }

  /// A reset has a confirmed reason.
  void checkStart(const StereoMessages& set) const {
    if (continues_ || !last_.left) return;
    const auto other_frame = [&](const StereoMessages& m) {
      return withoutLeadingSlash(m.left->header.frame_id) ==
             withoutLeadingSlash(set.left->header.frame_id);
    };
    const auto other_infos = [&](const StereoMessages& m) {
      return sameCalibration(*m.left_info, *set.left_info) &&
             sameCalibration(*m.right_info, *set.right_info);
    };
    require(confirmed(sets_of_mounting_, other_frame) || confirmed(sets_, other_infos) ||
                jumpConfirmed(set.left->header.stamp),
            "the odometry is reset only if three messages in a row confirm the reason");
  }

  /// True if the latest sets agree on a value that the last frame did not have.
  template <typename Agrees>
  bool confirmed(const std::vector<StereoMessages>& sets, const Agrees& agrees) const {
    return !agrees(last_) && sets.size() >= 3 && std::all_of(sets.end() - 3, sets.end(), agrees);
  }

  /// True if the stamps of three successive left images rise around this stamp, which is far before
  /// that of the last frame.
  bool jumpConfirmed(const ros::Time& stamp) const {
    const double back_s = last_.left->header.stamp.toSec() - stamp.toSec();
    if (back_s <= 1.0) return false;
    const std::vector<ros::Time>& all = left_stamps_;
    for (std::size_t i = 2; i < all.size(); ++i) {
      const bool rises = all[i - 2] < all[i - 1] && all[i - 1] < all[i];
      if (rises && !(stamp < all[i - 2]) && !(all[i] < stamp)) return true;
    }
    return false;
  }

  /// Nothing moves, so that only a reset may move the pose.
  void checkPose(const ProcessedFrame& frame) {
    if (processor_.wasReset()) T_odom_base_ = initial_pose_;
    const double moved_m = (frame.T_odom_base().translation() - T_odom_base_.translation()).norm();
    require(moved_m < 1e-6, "the pose stays where it is");
  }

  /// Published messages are valid.
  void checkMessages(const ProcessedFrame& frame) {
    require(frame.result.reason != TrackingReason::kException, frame.result.error);
    const nav_msgs::Odometry odometry = toOdometry(frame, {"odom", "base"});
    double sum = odometry.pose.pose.position.x + odometry.pose.pose.orientation.w;
    for (const double c : odometry.pose.covariance) sum += c;
    for (const double c : odometry.twist.covariance) sum += c;
    require(std::isfinite(sum), "what is published is finite");
    const double latency_ms = latencyMs(frame.header.stamp, ros::Time::now());
    require(latency_ms >= 0.0 && std::isfinite(latency_ms), "the latency is a number");
    toInfo(frame, {}, latency_ms);
    if (last_.left && frame.header.stamp < last_.left->header.stamp) tf_.clear();
    tf_.setTransform(toTransformStamped(frame, {"odom", "base"}, false), "fuzzer");
  }

  const Eigen::Isometry3d initial_pose_;
  Eigen::Isometry3d T_odom_base_;
  StereoInput input_;
  SensorMounting mounting_;
  FrameProcessor processor_;
  tf2::BufferCore tf_;
  std::exception_ptr broken_;
  bool continues_ = false;
  StereoMessages last_;  // of the last frame
  std::vector<ros::Time> left_stamps_;
  std::vector<StereoMessages> sets_of_mounting_;
  std::vector<StereoMessages> sets_;
};

AllParameters takeParameters(ByteReader* bytes) {
  const std::uint8_t choice = bytes->take<std::uint8_t>();
  AllParameters parameters;
  parameters.core.tracking.threads = 1;
  parameters.core.lines.enabled = false;  // there are none, and detection takes long
  parameters.node.initial_pose.x = 1.0;
  parameters.node.approximate_sync = (choice & 1U) != 0;
  parameters.node.rectify = (choice & 2U) != 0;
  const std::array<const char*, 3> policies{"reset", "keep_pose", "ignore"};
  parameters.node.on_time_jump = policies[(choice >> 2U) % policies.size()];
  return parameters;
}

}  // namespace

void fuzzStereoMessages(const std::uint8_t* data, std::size_t size) {
  ros::Time::init();
  ros::Time::setNow(ros::Time(2000.0));
  ByteReader bytes(data, size);
  Eigen::Isometry3d T_odom_base = Eigen::Isometry3d::Identity();
  T_odom_base.translation() = Eigen::Vector3d(5.0, -3.0, 2.0);
  Pipeline pipeline(takeParameters(&bytes), T_odom_base);
  std::int64_t clock_ns = kBegin_ns;
  for (int k = 0; k < kMaxFrames && !bytes.empty(); ++k) {
    pipeline.publish(takeFrame(&bytes, &clock_ns), k * kArrivalPeriod_s);
  }
}

}  // namespace point_line_odometry
