#include "ros/synthetic_stereo_nodelet.h"

#include <image_transport/image_transport.h>
#include <ros/init.h>
#include <rosgraph_msgs/Clock.h>
#include <tf2_msgs/TFMessage.h>

#include <algorithm>
#include <cmath>
#include <exception>
#include <pluginlib/class_list_macros.hpp>
#include <stdexcept>
#include <vector>

#include "ros/calibration_conversion.h"
#include "ros/parameter_tree.h"

namespace point_line_odometry {
namespace {

using std::chrono::duration;
using std::chrono::duration_cast;

constexpr std::uint32_t kQueueSize = 10;
constexpr std::uint32_t kImuQueueSize = 2000;
/// Samples are published until so long after a frame, beyond the largest time offset, and none that
/// are older than the frame by more.
constexpr std::int64_t kImuAhead_ns = 60000000;
constexpr std::int64_t kImuKept_ns = 500000000;
constexpr double kReportPeriod_s = 10.0;
/// Interval at which subscribers are looked for.
constexpr std::chrono::milliseconds kPoll{50};
/// Wait for subscribers before the first message about it.
constexpr std::chrono::seconds kPatience{5};
/// Timeout of an answer in lockstep, real time.
constexpr std::chrono::seconds kAnswerTimeout{2};
/// Time for the last messages to be sent before the process ends.
constexpr std::chrono::seconds kFlush{1};

/// Throws std::runtime_error if use_sim_time and publish_clock contradict each other.
void requireClock(bool publish_clock) {
  if (publish_clock && ros::Time::isSystemTime()) {
    throw std::runtime_error(
        "publish_clock is true, but this process runs on the wall clock: set /use_sim_time to "
        "true before it starts");
  }
  if (!publish_clock && ros::Time::isSimTime()) {
    throw std::runtime_error(
        "/use_sim_time is true, but publish_clock is not: set publish_clock, or /use_sim_time to "
        "false before the process starts");
  }
}

}  // namespace

SyntheticStereoNodelet::~SyntheticStereoNodelet() {
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    stopped_ = true;
  }
  changed_.notify_all();
  if (worker_.joinable()) worker_.join();
  answers_.shutdown();
}

void SyntheticStereoNodelet::onInit() {
  try {
    start(parseSyntheticStereoParameters(readPrivateParameters(getPrivateNodeHandle())));
  } catch (const std::exception& error) {
    NODELET_FATAL("%s does not start: %s", getName().c_str(), error.what());
    throw;
  }
}

void SyntheticStereoNodelet::start(const SyntheticStereoParameters& parameters) {
  parameters_ = parameters;
  played_ = playedCamera(parameters_.as);
  requireClock(parameters_.publish_clock);
  names_ = {parameters_.odom_frame_id, parameters_.base_frame_id, parameters_.left_frame_id,
            parameters_.right_frame_id};
  world_ = std::make_unique<SyntheticWorld>(parameters_.world);
  if (parameters_.length_m > 0.0)
    parameters_.frames = static_cast<int>(world_->framesForLength(parameters_.length_m));
  time_of_first_frame_ = parameters_.publish_clock ? StampShift(0).toRos(0) : ros::Time::now();
  advertise();
  const CameraCalibration& left = world_->calibration().left;
  NODELET_INFO("%s, seed %d: %d x %d pixels at %g frames/s on %s", parameters_.world.scene.c_str(),
               parameters_.world.seed, left.width, left.height, world_->frameRate_hz(),
               cameras_[0].images.getTopic().c_str());
  worker_ = std::thread(&SyntheticStereoNodelet::work, this);
}

void SyntheticStereoNodelet::advertise() {
  ros::NodeHandle& nh = getNodeHandle();
  image_transport::ImageTransport transport(nh);
  const std::string image = imageTopicName(world_->needsRectification());
  const auto camera = [&](const std::string& side, const std::string& frame) {
    return Camera{transport.advertise(side + "/" + image, kQueueSize),
                  nh.advertise<sensor_msgs::CameraInfo>(side + "/camera_info", kQueueSize),
                  parameters_.world.bonnet > 0.0
                      ? nh.advertise<sensor_msgs::Image>(side + "/mask_image", kQueueSize)
                      : ros::Publisher(),
                  frame,
                  frame,
                  ros::Duration(0)};
  };
  if (played_) {
    advertiseAs(*played_);
  } else {
    cameras_ = {camera("left", names_.left), camera("right", names_.right)};
  }
  ground_truth_ = std::make_unique<GroundTruthPublisher>(
      nh, names_, static_cast<std::size_t>(parameters_.path_max_length));
  imu_ = nh.advertise<sensor_msgs::Imu>("imu", kImuQueueSize);
  wheels_ = nh.advertise<nav_msgs::Odometry>(kWheelTopic, kImuQueueSize);
  // By this node's handle, and so with its remappings, which a StaticTransformBroadcaster does not
  // know in a nodelet.
  static_transforms_ = nh.advertise<tf2_msgs::TFMessage>("/tf_static", kQueueSize, true);
  tf2_msgs::TFMessage static_transforms;
  std::vector<geometry_msgs::TransformStamped>& transforms = static_transforms.transforms;
  transforms = toMountingTransforms(world_->calibration(), names_, time_of_first_frame_);
  transforms.push_back(toImuTransform(world_->imu(0).T_imu_camera, names_, time_of_first_frame_));
  transforms.push_back(
      toWheelTransform(world_->wheels(0).T_body_camera, names_, time_of_first_frame_));
  static_transforms_.publish(static_transforms);
  if (parameters_.publish_clock) clock_ = nh.advertise<rosgraph_msgs::Clock>("/clock", kQueueSize);
  if (!parameters_.lockstep_topic.empty()) {
    answers_ = nh.subscribe(parameters_.lockstep_topic, kQueueSize,
                            &SyntheticStereoNodelet::takeAnswer, this);
  }
}

/// The driver's own topics; of two images in one, the second camera has none.
void SyntheticStereoNodelet::advertiseAs(const PlayedCamera& played) {
  ros::NodeHandle& nh = getNodeHandle();
  image_transport::ImageTransport transport(nh);
  for (std::size_t i = 0; i < cameras_.size(); ++i) {
    const PlayedCamera::Side& side = played.sides[i];
    Camera& camera = cameras_[i];
    if (!side.image.empty()) camera.images = transport.advertise(side.image, kQueueSize);
    if (!side.info.empty())
      camera.infos = nh.advertise<sensor_msgs::CameraInfo>(side.info, kQueueSize);
    camera.frame = side.frame;
    camera.info_frame = side.info_frame;
  }
  cameras_[1].stamp_offset = ros::Duration(played.right_stamp_offset_s);
}

void SyntheticStereoNodelet::takeAnswer(const nav_msgs::OdometryConstPtr& answer) {
  const std::lock_guard<std::mutex> lock(mutex_);
  last_answer_ = answer->header.stamp;
  changed_.notify_all();
}

/// An exception that left this thread would end every nodelet of the manager.
void SyntheticStereoNodelet::work() {
  try {
    run();
  } catch (const std::exception& error) {
    NODELET_ERROR("the synthetic camera has stopped: %s", error.what());
  } catch (...) {
    NODELET_ERROR("the synthetic camera has stopped after an exception of an unknown type");
  }
}

void SyntheticStereoNodelet::run() {
  if (!waitToBegin()) return;
  due_ = Clock::now();
  if (!parameters_.publish_clock) time_of_first_frame_ = ros::Time::now();
  const auto end = static_cast<std::size_t>(parameters_.frames);
  for (std::size_t frame = 0; end == 0 || frame < end; frame = nextFrame(frame)) {
    if (!showFrame(frame)) return;
  }
  finish();
}

/// False if the nodelet is to end.
bool SyntheticStereoNodelet::waitToBegin() {
  const Clock::time_point patience_ends = Clock::now() + kPatience;
  while (parameters_.wait_for_subscribers) {
    const std::string missing = missingListeners();
    if (missing.empty()) break;
    if (Clock::now() > patience_ends) {
      if (log_throttle_.passes("waiting", kReportPeriod_s)) {
        NODELET_INFO_STREAM("waiting to begin until there is " << missing);
      }
    }
    if (!standStillUntil(Clock::now() + kPoll)) return false;
  }
  const auto delay = duration_cast<Clock::duration>(duration<double>(parameters_.delay_s));
  for (const Clock::time_point begin = Clock::now() + delay; Clock::now() < begin;) {
    if (!standStillUntil(std::min(begin, Clock::now() + kPoll))) return false;
  }
  return true;
}

/// Publishes the same simulated time until then. False if the nodelet is to end.
bool SyntheticStereoNodelet::standStillUntil(Clock::time_point time) {
  publishClock(time_of_first_frame_);
  return sleepUntil(time);
}

/// Text on the subscriber or publisher that the first frame waits for; empty if there is none.
std::string SyntheticStereoNodelet::missingListeners() const {
  for (const Camera& camera : cameras_) {
    if (camera.images && camera.images.getNumSubscribers() == 0) {
      return "a subscriber of " + camera.images.getTopic();
    }
    if (camera.infos && camera.infos.getNumSubscribers() == 0)
      return "a subscriber of " + camera.infos.getTopic();
  }
  if (answers_ && answers_.getNumPublishers() == 0) {
    return "a publisher of " + answers_.getTopic() + " (lockstep_topic)";
  }
  return {};
}

/// Renders a frame, waits until it is due and publishes it. False if the nodelet is to end.
bool SyntheticStereoNodelet::showFrame(std::size_t frame) {
  std::optional<StereoImages> images;
  if (somebodyWantsImages()) images = world_->render(frame);
  if (!waitForAnswer() || !waitUntilDue(world_->pose(frame).stamp_ns)) return false;
  publish(frame, images);
  return true;
}

/// The frame after it, or in real time the first one that is not overdue.
std::size_t SyntheticStereoNodelet::nextFrame(std::size_t frame) {
  if (parameters_.publish_clock) return frame + 1;
  const double late_s = duration<double>(Clock::now() - due_).count();
  const double late_frames = std::max(1.0, std::ceil(late_s * world_->frameRate_hz()));
  const std::size_t next = frame + static_cast<std::size_t>(late_frames);
  num_skipped_ += next - frame - 1;
  if (next > frame + 1) {
    if (log_throttle_.passes("too slow", kReportPeriod_s)) {
      NODELET_WARN_STREAM("this computer is too slow to render "
                          << world_->frameRate_hz() << " frames/s: " << num_skipped_ << " of "
                          << next << " frames skipped so far; lower "
                          << "frame_rate_hz, or set publish_clock");
    }
  }
  return next;
}

void SyntheticStereoNodelet::publish(std::size_t frame, const std::optional<StereoImages>& images) {
  const std::array<StampedPose, 3> poses = {world_->pose(frame > 0 ? frame - 1 : 0),
                                            world_->pose(frame), world_->pose(frame + 1)};
  const ros::Time stamp = toRosTime(poses[1].stamp_ns);
  publishClock(stamp);
  publishImu(frame);
  publishWheels(frame);
  const StereoCalibration& calibration = world_->calibration();
  if (played_ && played_->side_by_side) {
    cv::Mat both;
    if (images) cv::hconcat(images->left, images->right, both);
    publishCamera(cameras_[0], calibration.left, images ? &both : nullptr, nullptr, stamp);
  } else {
    publishCamera(cameras_[0], calibration.left, images ? &images->left : nullptr,
                  images ? &images->left_mask : nullptr, stamp);
    publishCamera(cameras_[1], calibration.right, images ? &images->right : nullptr,
                  images ? &images->right_mask : nullptr, stamp);
  }
  ground_truth_->publish(stamp, poses);
  if (images && answers_) unanswered_ = stamp;
}

void SyntheticStereoNodelet::publishCamera(const Camera& camera,
                                           const CameraCalibration& calibration,
                                           const cv::Mat* image, const cv::Mat* mask,
                                           const ros::Time& stamp) {
  const std_msgs::Header header = makeHeader(camera.frame, stamp + camera.stamp_offset);
  if (camera.infos) {
    camera.infos.publish(boost::make_shared<sensor_msgs::CameraInfo>(
        toCameraInfo(calibration, makeHeader(camera.info_frame, header.stamp))));
  }
  if (mask && camera.masks) camera.masks.publish(toImageMessage(*mask, header));
  const std::string encoding = played_ ? played_->encoding : "mono8";
  if (image) camera.images.publish(toImageMessage(*image, header, encoding));
}

/// The samples since the last frame, and those that end the interval until this one.
void SyntheticStereoNodelet::publishImu(std::size_t frame) {
  const std::int64_t until_ns = world_->pose(frame).stamp_ns + kImuAhead_ns;
  if (!next_imu_) next_imu_ = world_->imuSamples();
  while (last_imu_ns_ < until_ns) {
    const ImuSample sample = next_imu_();
    last_imu_ns_ = sample.stamp_ns;
    if (sample.stamp_ns < until_ns - kImuKept_ns) continue;
    imu_.publish(toImuMessage(sample, makeHeader(names_.imu, toRosTime(sample.stamp_ns))));
  }
}

/// As publishImu().
void SyntheticStereoNodelet::publishWheels(std::size_t frame) {
  const std::int64_t until_ns = world_->pose(frame).stamp_ns + kImuAhead_ns;
  if (!next_wheels_) next_wheels_ = world_->wheelSamples();
  while (!last_wheels_ || last_wheels_->stamp_ns < until_ns) {
    const OdometrySample sample = next_wheels_();
    if (sample.stamp_ns >= until_ns - kImuKept_ns) {
      wheels_.publish(toWheelMessage(sample, last_wheels_ ? &*last_wheels_ : nullptr, names_,
                                     toRosTime(sample.stamp_ns)));
    }
    last_wheels_ = sample;
  }
}

void SyntheticStereoNodelet::publishClock(const ros::Time& time) {
  if (!clock_) return;
  rosgraph_msgs::Clock clock;
  clock.clock = time;
  clock_.publish(clock);
}

bool SyntheticStereoNodelet::somebodyWantsImages() const {
  return std::any_of(cameras_.begin(), cameras_.end(), [](const Camera& camera) {
    return camera.images && camera.images.getNumSubscribers() > 0;
  });
}

void SyntheticStereoNodelet::finish() {
  if (!waitForAnswer()) return;
  ground_truth_->publishPath();
  NODELET_INFO("all %d frames are done", parameters_.frames);
  if (parameters_.exit_when_done && sleepUntil(Clock::now() + kFlush)) ros::requestShutdown();
}

/// Waits in real time until the time of exposure; in simulated time so that frames are not faster
/// than `rate`, without catching up on delays. False if the nodelet is to end.
bool SyntheticStereoNodelet::waitUntilDue(std::int64_t stamp_ns) {
  const std::chrono::nanoseconds step(stamp_ns - last_stamp_ns_);
  last_stamp_ns_ = stamp_ns;
  due_ += duration_cast<Clock::duration>(duration<double>(step) / parameters_.rate);
  if (parameters_.publish_clock) due_ = std::max(due_, Clock::now());
  return sleepUntil(due_);
}

/// Waits until the frame published last is answered, but not forever. False if the nodelet is to
/// end.
bool SyntheticStereoNodelet::waitForAnswer() {
  if (!unanswered_) return true;
  const ros::Time stamp = *unanswered_;
  unanswered_.reset();
  const Clock::time_point latest = Clock::now() + kAnswerTimeout;
  std::unique_lock<std::mutex> lock(mutex_);
  while (!stopped_ && last_answer_ != stamp && answers_.getNumPublishers() > 0) {
    if (Clock::now() > latest) {
      if (log_throttle_.passes("no answer", kReportPeriod_s)) {
        NODELET_WARN("no answer on %s to a frame: going on without it",
                     answers_.getTopic().c_str());
      }
      break;
    }
    changed_.wait_for(lock, kPoll);
  }
  return !stopped_;
}

/// False if the nodelet is to end.
bool SyntheticStereoNodelet::sleepUntil(Clock::time_point time) {
  std::unique_lock<std::mutex> lock(mutex_);
  return !changed_.wait_until(lock, time, [this] { return stopped_; });
}

ros::Time SyntheticStereoNodelet::toRosTime(std::int64_t stamp_ns) const {
  ros::Duration since_first;
  since_first.fromNSec(stamp_ns);
  return time_of_first_frame_ + since_first;
}

}  // namespace point_line_odometry

PLUGINLIB_EXPORT_CLASS(point_line_odometry::SyntheticStereoNodelet, nodelet::Nodelet)
