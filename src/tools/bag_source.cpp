#include "tools/bag_source.h"

#include <console_bridge/console.h>
#include <nav_msgs/Odometry.h>
#include <rosbag/bag.h>
#include <rosbag/view.h>
#include <sensor_msgs/CameraInfo.h>
#include <sensor_msgs/Image.h>
#include <sensor_msgs/Imu.h>
#include <tf2/buffer_core.h>
#include <tf2/exceptions.h>
#include <tf2_msgs/TFMessage.h>

#include <algorithm>
#include <array>
#include <cstdlib>
#include <deque>
#include <map>
#include <optional>
#include <set>
#include <vector>

#include "common/input_error.h"
#include "ros/calibration_conversion.h"
#include "ros/conversions.h"
#include "ros/image_conversion.h"
#include "ros/sample_input.h"

namespace point_line_odometry {
namespace {

class BagSource : public StereoSource {
 public:
  explicit BagSource(const BagOptions& options) : options_(options) {
    guarded([this] {
      open();
      chooseTopics();
      readCalibration();
      if (options_.masks) findMasks();
    });
  }

  std::size_t size() const override { return size_; }
  const StereoCalibration& calibration() const override { return calibration_; }
  bool needsRectification() const override { return options_.topics.raw(); }
  std::size_t unsynchronized() const override { return unsynchronized_; }

  /// All samples of the one IMU; its pose is looked up in the bag's /tf_static.
  std::optional<ImuData> imu() override {
    std::optional<ImuData> data;
    guarded([&] { data = readImu(); });
    return data;
  }

  /// The poses on the wheels' topic; of the body that its last message names.
  std::optional<WheelData> wheels() override {
    std::optional<WheelData> data;
    guarded([&] { data = readWheels(); });
    return data;
  }

  /// That in the bag's /tf_static, if base_link is there.
  Eigen::Isometry3d T_base_camera() override {
    Eigen::Isometry3d T = StereoSource::T_base_camera();
    guarded([&] {
      const tf2::BufferCore& transforms = staticTransforms();
      const std::string camera = withoutLeadingSlash(left_info_->header.frame_id);
      if (transforms.canTransform("base_link", camera, ros::Time(0)))
        T = toIsometry(transforms.lookupTransform("base_link", camera, ros::Time(0)).transform);
    });
    return T;
  }

  std::optional<StereoImages> next() override {
    std::optional<StereoImages> images;
    guarded([&] {
      while (!images && message_ != view_->end()) {
        take(*message_);
        ++message_;
        if (findPair()) images = pair();
      }
      if (!images) finish();
    });
    return images;
  }

 private:
  using ImageQueue = std::deque<sensor_msgs::Image::ConstPtr>;

  /// Limit of the images of one camera that wait for their partners.
  static constexpr std::size_t kMaxWaiting = 100;

  /// Runs a step and prefixes its errors with the name of the bag.
  template <typename Step>
  void guarded(const Step& step) {
    const std::string bag = "bag '" + options_.file + "' ";
    try {
      step();
    } catch (const rosbag::BagUnindexedException&) {
      throw InputError(bag + "was not closed: repair it with 'rosbag reindex'");
    } catch (const rosbag::BagException& error) {
      if (std::string(error.what()).find("Unsupported bag file version") != std::string::npos) {
        throw InputError(bag + "is of a version that cannot be read (" + error.what() +
                         "; those that can are 1.2 and 2.0): convert it to 2.0");
      }
      throw InputError(
          bag + "cannot be read (" + error.what() +
          "): it is cut off, damaged or no bag; try 'rosbag reindex' or fetch it again");
    } catch (const ros::Exception& error) {
      throw InputError(bag + "is damaged (" + error.what() + "): record or fetch it again");
    } catch (const MessageError& error) {
      throw InputError(bag + "cannot be used: " + error.what());
    } catch (const InputError& error) {
      throw InputError(bag + error.what());
    }
  }

  void open() {
    // The bag library logs faults before it throws them; the exception reports them once.
    console_bridge::noOutputHandler();
    bag_.open(options_.file, rosbag::bagmode::Read);
    rosbag::View all(bag_);
    for (const rosbag::ConnectionInfo* connection : all.getConnections()) {
      if (connection->datatype == "sensor_msgs/Image") images_.insert(connection->topic);
      if (connection->datatype == "sensor_msgs/CameraInfo") infos_.insert(connection->topic);
      if (connection->datatype == "sensor_msgs/Imu") imus_.insert(connection->topic);
    }
  }

  void chooseTopics() {
    StereoTopics& topics = options_.topics;
    if (topics.left.empty() && topics.right.empty()) {
      topics = findStereoTopics(images_);
    } else if (topics.right.empty()) {
      topics.right = rightTopicOf(topics.left);
    }
    if (topics.left.empty() || topics.right.empty()) {
      throw InputError("needs both --left-topic and --right-topic here; image topics in it: " +
                       joinNames(images_));
    }
    for (const std::string& topic : {topics.left, topics.right}) {
      if (images_.count(topic) == 0) {
        throw InputError(
            "has no topic '" + topic + "' of type sensor_msgs/Image: name both " +
            "cameras by --left-topic and --right-topic; image topics in it: " + joinNames(images_));
      }
    }
    if (topics.left == topics.right) {
      throw InputError("is given the same topic twice: give --right-topic the right camera's");
    }
  }

  void readCalibration() {
    const StereoTopics& topics = options_.topics;
    left_info_ = firstInfo(cameraInfoTopic(topics.left));
    right_info_ = firstInfo(cameraInfoTopic(topics.right));
    calibration_ = toStereoCalibration(*left_info_, *right_info_);
    size_ = std::min(rosbag::View(bag_, rosbag::TopicQuery(topics.left)).size(),
                     rosbag::View(bag_, rosbag::TopicQuery(topics.right)).size());
    view_ = std::make_unique<rosbag::View>(
        bag_, rosbag::TopicQuery(std::vector<std::string>{topics.left, topics.right,
                                                          cameraInfoTopic(topics.left),
                                                          cameraInfoTopic(topics.right)}));
    message_ = view_->begin();
  }

  std::optional<ImuData> readImu() {
    if (imus_.empty()) return std::nullopt;
    if (imus_.size() > 1) {
      throw InputError("has several IMUs: keep one by 'rosbag filter'; topics: " +
                       joinNames(imus_));
    }
    ImuData data;
    std::string frame;
    rosbag::View view(bag_, rosbag::TopicQuery(*imus_.begin()));
    for (const rosbag::MessageInstance& message : view) {
      const auto imu = instantiate<sensor_msgs::Imu>(message);
      data.samples.push_back(toSample(*imu).sample);
      frame = withoutLeadingSlash(imu->header.frame_id);
    }
    if (data.samples.empty()) return std::nullopt;
    data.T_imu_camera = lookUp(frame, "the IMU, which imu/enabled needs");
    return data;
  }

  /// Messages that are no pose are left out, as by the node.
  std::optional<WheelData> readWheels() {
    WheelData data;
    std::string frame;
    rosbag::View view(bag_, rosbag::TopicQuery(options_.wheel_topic));
    for (const rosbag::MessageInstance& message : view) {
      if (message.getDataType() != "nav_msgs/Odometry") {
        throw InputError("has '" + options_.wheel_topic + "' of type " + message.getDataType() +
                         ", but the wheels' must be nav_msgs/Odometry: name it by --wheel-topic");
      }
      try {
        const auto pose = toSample(*instantiate<nav_msgs::Odometry>(message));
        data.samples.push_back(pose.sample);
        frame = pose.frame_id;
      } catch (const MessageError&) {
        continue;
      }
    }
    if (data.samples.empty()) return std::nullopt;
    // Without a frame they are of the base.
    data.T_body_camera =
        frame.empty() ? T_base_camera() : lookUp(frame, "the wheels, which wheels/enabled needs");
    return data;
  }

  const tf2::BufferCore& staticTransforms() {
    if (static_transforms_) return *static_transforms_;
    static_transforms_ = std::make_unique<tf2::BufferCore>();
    rosbag::View view(bag_, rosbag::TopicQuery("/tf_static"));
    for (const rosbag::MessageInstance& message : view) {
      for (const auto& transform : instantiate<tf2_msgs::TFMessage>(message)->transforms)
        static_transforms_->setTransform(transform, "bag", true);
    }
    return *static_transforms_;
  }

  /// Static pose of the camera in a frame. \param what that frame is of.
  Eigen::Isometry3d lookUp(const std::string& target, const std::string& what) {
    const std::string source = withoutLeadingSlash(left_info_->header.frame_id);
    try {
      return toIsometry(staticTransforms().lookupTransform(target, source, ros::Time(0)).transform);
    } catch (const tf2::TransformException& error) {
      throw InputError("has no static transform from the camera to " + what + ": " +
                       std::string(error.what()));
    }
  }

  sensor_msgs::CameraInfo::ConstPtr firstInfo(const std::string& topic) {
    rosbag::View view(bag_, rosbag::TopicQuery(topic));
    if (infos_.count(topic) == 0 || view.size() == 0) {
      throw InputError("has no topic '" + topic +
                       "' of type sensor_msgs/CameraInfo: record it together with the images");
    }
    return instantiate<sensor_msgs::CameraInfo>(*view.begin());
  }

  template <typename Message>
  static typename Message::ConstPtr instantiate(const rosbag::MessageInstance& message) {
    typename Message::ConstPtr instance = message.instantiate<Message>();
    if (!instance) {
      throw InputError("has messages of another version of " + message.getDataType() + " on '" +
                       message.getTopic() + "': migrate it with 'rosbag fix'");
    }
    return instance;
  }

  void take(const rosbag::MessageInstance& message) {
    const std::string& topic = message.getTopic();
    if (topic == options_.topics.left) {
      enqueue(message, &waiting_left_);
    } else if (topic == options_.topics.right) {
      enqueue(message, &waiting_right_);
    } else {
      const bool left = topic == cameraInfoTopic(options_.topics.left);
      const auto info = instantiate<sensor_msgs::CameraInfo>(message);
      if (sameCalibration(*info, left ? *left_info_ : *right_info_)) return;
      throw InputError("changes its calibration on '" + topic + "' at " +
                       std::to_string(info->header.stamp.toSec()) +
                       " s: cut it there with 'rosbag filter' and run the parts apart");
    }
  }

  void enqueue(const rosbag::MessageInstance& message, ImageQueue* queue) {
    queue->push_back(instantiate<sensor_msgs::Image>(message));
    if (queue->size() > kMaxWaiting) drop(queue);
  }

  void drop(ImageQueue* queue) {
    queue->pop_front();
    ++unsynchronized_;
  }

  /// Masks are found by their stamps: they may lie anywhere in the bag, as a network needs time.
  void findMasks() {
    const std::array<std::string, 2> topics{maskTopic(options_.topics.left),
                                            maskTopic(options_.topics.right)};
    for (std::size_t i = 0; i < topics.size(); ++i) {
      if (images_.count(topics[i]) == 0) continue;
      mask_views_[i] = std::make_unique<rosbag::View>(bag_, rosbag::TopicQuery(topics[i]));
      for (const rosbag::MessageInstance& message : *mask_views_[i]) {
        const auto mask = instantiate<sensor_msgs::Image>(message);
        masks_[i].insert({toNanoseconds(mask->header.stamp), message});
      }
    }
    if (!masks_[0].empty() || !masks_[1].empty()) return;
    throw InputError("has no masks on '" + topics[0] + "' or '" + topics[1] +
                     "': leave out --mask-images, or record these topics");
  }

  StereoImages pair() {
    StereoImages images = toStereoImages(*left_, *right_, calibration_);
    images.left_mask = maskOf(*left_, masks_[0], calibration_.left);
    images.right_mask = maskOf(*right_, masks_[1], calibration_.right);
    return images;
  }

  cv::Mat maskOf(const sensor_msgs::Image& image,
                 const std::map<std::int64_t, rosbag::MessageInstance>& masks,
                 const CameraCalibration& camera) {
    const auto found = masks.find(toNanoseconds(image.header.stamp));
    if (found == masks.end()) return {};
    return toMask(*instantiate<sensor_msgs::Image>(found->second), camera);
  }

  /// Moves the oldest pair from the queues to left_ and right_; older images without partner are
  /// dropped.
  bool findPair() {
    while (!waiting_left_.empty() && !waiting_right_.empty()) {
      const std::int64_t ahead_ns = toNanoseconds(waiting_left_.front()->header.stamp) -
                                    toNanoseconds(waiting_right_.front()->header.stamp);
      if (std::abs(ahead_ns) <= options_.max_interval_ns) {
        left_ = waiting_left_.front();
        right_ = waiting_right_.front();
        waiting_left_.pop_front();
        waiting_right_.pop_front();
        ++pairs_;
        return true;
      }
      drop(ahead_ns < 0 ? &waiting_left_ : &waiting_right_);
    }
    return false;
  }

  void finish() {
    unsynchronized_ += waiting_left_.size() + waiting_right_.size();
    waiting_left_.clear();
    waiting_right_.clear();
    if (pairs_ > 0) return;
    throw InputError(
        "has no left and right image of equal stamp: synchronise the cameras, or "
        "allow a difference by --approximate-sync SECONDS");
  }

  BagOptions options_;
  rosbag::Bag bag_;
  std::set<std::string> images_;
  std::set<std::string> infos_;
  std::set<std::string> imus_;
  sensor_msgs::CameraInfo::ConstPtr left_info_;
  sensor_msgs::CameraInfo::ConstPtr right_info_;
  StereoCalibration calibration_;
  std::size_t size_ = 0;
  std::unique_ptr<tf2::BufferCore> static_transforms_;
  std::unique_ptr<rosbag::View> view_;
  rosbag::View::iterator message_;
  ImageQueue waiting_left_;
  ImageQueue waiting_right_;
  sensor_msgs::Image::ConstPtr left_;
  sensor_msgs::Image::ConstPtr right_;
  std::array<std::unique_ptr<rosbag::View>, 2> mask_views_;
  std::array<std::map<std::int64_t, rosbag::MessageInstance>, 2> masks_;  // by stamp
  std::size_t pairs_ = 0;
  std::size_t unsynchronized_ = 0;
};

}  // namespace

std::unique_ptr<StereoSource> openBag(const BagOptions& options) {
  return std::make_unique<BagSource>(options);
}

}  // namespace point_line_odometry
