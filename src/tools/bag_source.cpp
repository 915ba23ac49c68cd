#include "tools/bag_source.h"

#include <nav_msgs/Odometry.h>
#include <rosbag/view.h>
#include <sensor_msgs/CameraInfo.h>
#include <sensor_msgs/Image.h>
#include <sensor_msgs/Imu.h>
#include <tf2/buffer_core.h>
#include <tf2/exceptions.h>
#include <tf2_msgs/TFMessage.h>

#include <algorithm>
#include <array>
#include <deque>
#include <map>
#include <optional>
#include <set>
#include <tuple>
#include <utility>
#include <vector>

#include "common/input_error.h"
#include "ros/calibration_conversion.h"
#include "ros/confirmation.h"
#include "ros/conversions.h"
#include "ros/image_conversion.h"
#include "ros/sample_input.h"
#include "ros/stereo_input.h"
#include "tools/input_bag.h"

namespace point_line_odometry {
namespace {

/// Synchronises as the node does. What waits for its partners is as much as a bag can have that was
/// recorded of one camera after the other by bursts.
NodeParameters synchronisation(std::int64_t max_interval_ns) {
  NodeParameters parameters;
  parameters.queue_size = 100;
  parameters.approximate_sync = max_interval_ns > 0;
  parameters.approximate_sync_max_interval_s = 1e-9 * static_cast<double>(max_interval_ns);
  return parameters;
}

/// What is left out of a bag, with the first reason.
struct LeftOut {
  std::size_t count = 0;
  std::string first;

  void add(const std::string& reason) {
    if (count++ == 0) first = reason;
  }
};

class BagSource : public StereoSource {
 public:
  explicit BagSource(const BagOptions& options)
      : options_(options), bag_(options.file), topics_(bag_.chooseTopics(options.topics)) {
    bag_.guarded([this] {
      readCalibration();
      if (options_.masks) findMasks();
    });
  }

  std::size_t size() const override { return size_; }
  const StereoCalibration& calibration() const override { return calibration_; }
  bool needsRectification() const override { return topics_.raw(); }
  std::size_t unsynchronized() const override { return lonely_; }

  std::vector<std::string> warnings() const override {
    std::vector<std::string> warnings;
    const auto warn = [&](const LeftOut& left_out, const std::string& what) {
      if (left_out.count == 0) return;
      warnings.push_back("bag '" + options_.file + "': " + std::to_string(left_out.count) + " " +
                         what + ", the first as " + left_out.first);
    };
    warn(wrong_stamps_, "images are not used for their stamps");
    warn(damaged_, "pairs are not used");
    warn(other_infos_, "camera_infos are not used");
    warn(masks_left_out_, "masks are not used");
    constexpr std::size_t kAtEnds = 2;
    const std::size_t lonely = lonely_ - std::min(lonely_, wrong_stamps_.count);
    if (lonely > kAtEnds) {
      warnings.push_back("bag '" + options_.file + "': " + std::to_string(lonely) +
                         " images have no partner of the other camera");
    }
    return warnings;
  }

  /// All samples of the IMU; its pose is looked up in the bag's /tf_static.
  std::optional<ImuData> imu() override {
    std::optional<ImuData> data;
    bag_.guarded([&] { data = readImu(); });
    return data;
  }

  /// The poses on the wheels' topic; of the body that its last message names.
  std::optional<WheelData> wheels() override {
    std::optional<WheelData> data;
    bag_.guarded([&] { data = readWheels(); });
    return data;
  }

  /// That in the bag's /tf_static, if base_link is there.
  Eigen::Isometry3d T_base_camera() override {
    Eigen::Isometry3d T = StereoSource::T_base_camera();
    bag_.guarded([&] {
      const tf2::BufferCore& transforms = staticTransforms();
      const std::string camera = withoutLeadingSlash(infos_[0]->header.frame_id);
      if (transforms.canTransform("base_link", camera, ros::Time(0)))
        T = toIsometry(transforms.lookupTransform("base_link", camera, ros::Time(0)).transform);
    });
    return T;
  }

  std::optional<StereoImages> next() override {
    std::optional<StereoImages> images;
    bag_.guarded([&] {
      while (!images && readUntilPair()) images = takePair();
      if (!images) requirePairs();
    });
    return images;
  }

 private:
  using ImageQueue = std::deque<sensor_msgs::Image::ConstPtr>;

  void readCalibration() {
    for (const std::string& topic : {topics_.left, topics_.right}) {
      if (bag_.topics().images.count(topic) > 0) continue;
      throw InputError("has no topic '" + topic + "' of type sensor_msgs/Image: name both " +
                       "cameras by --left-topic and --right-topic; image topics in it: " +
                       joinNames(bag_.topics().images));
    }
    names_ = {topics_.left, topics_.right, cameraInfoTopic(topics_.left),
              cameraInfoTopic(topics_.right)};
    infos_ = {firstInfo(names_[kLeftInfo]), firstInfo(names_[kRightInfo])};
    calibration_ = toStereoCalibration(*infos_[0], *infos_[1]);
    size_ = std::min(bag_.view({topics_.left})->size(), bag_.view({topics_.right})->size());
    view_ = bag_.view({names_.begin(), names_.end()});
    message_ = view_->begin();
    input_ = std::make_unique<StereoInput>(
        synchronisation(options_.max_interval_ns), names_,
        [this](const StereoMessages& pair) { addPair(pair); },
        [this](const std::string& fault) { noteWrongStamp(fault); }, [this] { return now_; });
  }

  std::optional<ImuData> readImu() {
    const std::set<std::string>& imus = bag_.topics().imus;
    const std::string topic =
        options_.imu_topic.empty() ? bag_.findImu(topics_) : options_.imu_topic;
    if (topic.empty() && imus.empty()) return std::nullopt;
    if (imus.count(topic) == 0) {
      throw InputError("has " +
                       std::string(topic.empty() ? "several IMUs" : "no IMU '" + topic + "'") +
                       ": name that of the camera by --imu-topic (it has rates and accelerations "
                       "in one message); topics: " +
                       joinNames(imus));
    }
    ImuData data;
    std::string frame;
    const auto view = bag_.view({topic});
    for (const rosbag::MessageInstance& message : *view) {
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
    const auto view = bag_.view({options_.wheel_topic});
    for (const rosbag::MessageInstance& message : *view) {
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
    const auto view = bag_.view({"/tf_static"});
    for (const rosbag::MessageInstance& message : *view) {
      for (const auto& transform : instantiate<tf2_msgs::TFMessage>(message)->transforms)
        static_transforms_->setTransform(transform, "bag", true);
    }
    return *static_transforms_;
  }

  /// Static pose of the camera in a frame. \param what that frame is of.
  Eigen::Isometry3d lookUp(const std::string& target, const std::string& what) {
    const std::string source = withoutLeadingSlash(infos_[0]->header.frame_id);
    try {
      return toIsometry(staticTransforms().lookupTransform(target, source, ros::Time(0)).transform);
    } catch (const tf2::TransformException& error) {
      throw InputError("has no static transform from the camera to " + what + ": " +
                       std::string(error.what()));
    }
  }

  sensor_msgs::CameraInfo::ConstPtr firstInfo(const std::string& topic) {
    const auto view = bag_.view({topic});
    if (bag_.topics().infos.count(topic) == 0 || view->size() == 0) {
      throw InputError("has no topic '" + topic +
                       "' of type sensor_msgs/CameraInfo: record it together with the images");
    }
    return instantiate<sensor_msgs::CameraInfo>(*view->begin());
  }

  /// False at the end of the bag.
  bool readUntilPair() {
    while (pairs_.empty() && message_ != view_->end()) {
      take(*message_);
      ++message_;
    }
    if (pairs_.empty() && !ended_) end();
    return !pairs_.empty();
  }

  /// By the clock of the bag: what is a wild stamp does not depend on today.
  void take(const rosbag::MessageInstance& message) {
    now_ = message.getTime();
    const std::string& topic = message.getTopic();
    const double time_s = message.getTime().toSec();
    if (topic == topics_.left) {
      addImage(kLeftImage, instantiate<sensor_msgs::Image>(message), time_s);
    } else if (topic == topics_.right) {
      addImage(kRightImage, instantiate<sensor_msgs::Image>(message), time_s);
    } else {
      checkInfo(topic == names_[kLeftInfo] ? 0 : 1, *instantiate<sensor_msgs::CameraInfo>(message));
    }
  }

  /// With a camera_info, which the node expects with each image and a bag may have but once.
  void addImage(StereoTopic topic, const sensor_msgs::Image::ConstPtr& image, double time_s) {
    constexpr std::size_t kMaxWaiting = 200;  // more than what StereoInput keeps
    ImageQueue& waiting = waiting_[topic];
    waiting.push_back(image);
    if (waiting.size() > kMaxWaiting) dropFirst(&waiting);
    const auto info = boost::make_shared<sensor_msgs::CameraInfo>();
    info->header = image->header;
    input_->addImage(topic, image, time_s);
    input_->addInfo(topic == kLeftImage ? kLeftInfo : kRightInfo, info, time_s);
  }

  void end() {
    ended_ = true;
    input_->flush();
    for (ImageQueue& waiting : waiting_) {
      while (!waiting.empty()) dropFirst(&waiting);
    }
  }

  void addPair(const StereoMessages& pair) {
    pairs_.emplace_back(pair.left, pair.right);
    ++num_pairs_;
    dropUntil(pair.left, &waiting_[kLeftImage]);
    dropUntil(pair.right, &waiting_[kRightImage]);
  }

  void dropFirst(ImageQueue* waiting) {
    waiting->pop_front();
    ++lonely_;
  }

  /// Those before an image have no partner.
  void dropUntil(const sensor_msgs::Image::ConstPtr& image, ImageQueue* waiting) {
    const auto found = std::find(waiting->begin(), waiting->end(), image);
    if (found == waiting->end()) return;
    while (waiting->front() != image) dropFirst(waiting);
    waiting->pop_front();
  }

  void noteWrongStamp(const std::string& fault) {
    const auto isOf = [&](const std::string& topic) { return fault.rfind(topic + ":", 0) == 0; };
    if (isOf(topics_.left) || isOf(topics_.right)) wrong_stamps_.add(fault);
  }

  /// As the node, which accepts another calibration only once it is confirmed; here that is an
  /// error.
  void checkInfo(std::size_t camera, const sensor_msgs::CameraInfo& info) {
    const char* const field = differingField(info, *infos_[camera]);
    if (field == nullptr) {
      differing_in_a_row_[camera] = 0;
      return;
    }
    const std::string where = std::string(field) + " on '" + names_[kLeftInfo + camera] + "' at " +
                              std::to_string(info.header.stamp.toSec()) + " s";
    other_infos_.add(where + " is not as in the first one");
    if (++differing_in_a_row_[camera] < kConfirmations) return;
    throw InputError("changes its calibration, " + where +
                     ": cut it there with 'rosbag filter' and run the parts apart");
  }

  /// Nothing if an image of the pair cannot be used.
  std::optional<StereoImages> takePair() {
    std::tie(left_, right_) = pairs_.front();
    pairs_.pop_front();
    try {
      StereoImages images = toStereoImages(*left_, *right_, calibration_);
      images.left_mask = maskOf(*left_, masks_[0], calibration_.left);
      images.right_mask = maskOf(*right_, masks_[1], calibration_.right);
      ++num_used_;
      return images;
    } catch (const MessageError& error) {
      damaged_.add("'" + topics_.left + "', '" + topics_.right + "' at " +
                   std::to_string(left_->header.stamp.toSec()) + " s: " + error.what());
      return std::nullopt;
    }
  }

  void requirePairs() const {
    if (num_used_ > 0) return;
    if (num_pairs_ > 0) throw InputError("has no pair that can be used: " + damaged_.first);
    if (wrong_stamps_.count > 0)
      throw InputError("has no pair that can be used: " + wrong_stamps_.first);
    throw InputError(
        "has no left and right image of equal stamp: synchronise the cameras, or "
        "allow a difference by --approximate-sync SECONDS");
  }

  /// Masks are found by their stamps: they may lie anywhere in the bag, as a network needs time.
  void findMasks() {
    const std::array<std::string, 2> topics{maskTopic(topics_.left), maskTopic(topics_.right)};
    for (std::size_t i = 0; i < topics.size(); ++i) {
      if (bag_.topics().images.count(topics[i]) == 0) continue;
      mask_views_[i] = bag_.view({topics[i]});
      for (const rosbag::MessageInstance& message : *mask_views_[i]) {
        const auto mask = instantiate<sensor_msgs::Image>(message);
        masks_[i].insert({toNanoseconds(mask->header.stamp), message});
      }
    }
    if (!masks_[0].empty() || !masks_[1].empty()) return;
    throw InputError("has no masks on '" + topics[0] + "' or '" + topics[1] +
                     "': leave out --mask-images, or record these topics");
  }

  cv::Mat maskOf(const sensor_msgs::Image& image,
                 const std::map<std::int64_t, rosbag::MessageInstance>& masks,
                 const CameraCalibration& camera) {
    const auto found = masks.find(toNanoseconds(image.header.stamp));
    if (found == masks.end()) return {};
    try {
      return toMask(*instantiate<sensor_msgs::Image>(found->second), camera);
    } catch (const MessageError& error) {  // as good as none, as for the node
      masks_left_out_.add(error.what());
      return {};
    }
  }

  const BagOptions options_;
  const InputBag bag_;
  const StereoTopics topics_;
  StereoInput::TopicNames names_;
  std::array<sensor_msgs::CameraInfo::ConstPtr, 2> infos_;
  StereoCalibration calibration_;
  std::size_t size_ = 0;
  std::unique_ptr<tf2::BufferCore> static_transforms_;
  std::unique_ptr<rosbag::View> view_;
  rosbag::View::iterator message_;
  ros::Time now_;
  std::unique_ptr<StereoInput> input_;
  std::deque<std::pair<sensor_msgs::Image::ConstPtr, sensor_msgs::Image::ConstPtr>> pairs_;
  sensor_msgs::Image::ConstPtr left_;  // the last pair
  sensor_msgs::Image::ConstPtr right_;
  std::array<std::unique_ptr<rosbag::View>, 2> mask_views_;
  std::array<std::map<std::int64_t, rosbag::MessageInstance>, 2> masks_;  // by stamp
  bool ended_ = false;
  std::array<ImageQueue, 2> waiting_;  // for their partners
  std::size_t lonely_ = 0;             // images without
  std::size_t num_pairs_ = 0;
  std::size_t num_used_ = 0;
  std::array<int, 2> differing_in_a_row_{};  // camera_infos
  LeftOut wrong_stamps_;
  LeftOut damaged_;
  LeftOut other_infos_;
  LeftOut masks_left_out_;
};

}  // namespace

std::unique_ptr<StereoSource> openBag(const BagOptions& options) {
  return std::make_unique<BagSource>(options);
}

}  // namespace point_line_odometry
