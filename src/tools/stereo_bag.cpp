#include "tools/stereo_bag.h"

#include <nav_msgs/Path.h>
#include <ros/names.h>
#include <tf2_msgs/TFMessage.h>

#include <algorithm>
#include <cstdlib>
#include <iostream>
#include <optional>
#include <utility>
#include <vector>

#include "common/input_error.h"
#include "ros/bag_file.h"
#include "ros/calibration_conversion.h"
#include "ros/camera_messages.h"
#include "ros/conversions.h"

namespace point_line_odometry {
namespace {

rosbag::CompressionType toCompression(const std::string& name) {
  if (name == "none") return rosbag::compression::Uncompressed;
  if (name == "lz4") return rosbag::compression::LZ4;
  if (name == "bz2") return rosbag::compression::BZ2;
  throw InputError("compression '" + name + "' is unknown: choose none, lz4 or bz2");
}

/// The name space as "/a/b", "" for the root.
std::string normalizeNamespace(std::string name) {
  name.erase(0, name.find_first_not_of('/'));
  while (!name.empty() && name.back() == '/') name.pop_back();
  std::string error;
  if (!name.empty() && !ros::names::validate(name, error)) {
    throw InputError("name space '" + name + "' is no name in ROS: use letters, digits, _ and /");
  }
  return name.empty() ? "" : "/" + name;
}

/// A bag for stereo nodes: images with their masks, camera_info, static transforms and, where it is
/// known, the ground truth as a path.
class StereoBag {
 public:
  /// \param source of calibration and ground truth; must outlive the bag. Throws
  /// InputError for bad options.
  StereoBag(const StereoBagOptions& options, StereoSource& source)
      : source_(source),
        imu_(source.imu()),
        wheels_(source.wheels()),
        name_space_(normalizeNamespace(options.name_space)),
        bag_(options.file, toCompression(options.compression), "/dataset_to_bag") {}

  std::string imageTopic(const char* side) const {
    return name_space_ + "/" + side + "/" + imageTopicName(source_.needsRectification());
  }

  /// True if stamps are shifted, since those of the source begin at 0.
  bool shifts() const { return StampShift(first_ns_).shifts(); }

  void add(StereoImages images) {
    if (!last_) begin(images.stamp_ns);
    if (last_) write(*last_);
    last_ = std::move(images);
  }

  /// Writes the remaining messages and renames the bag.
  void commit() {
    if (last_) {
      // The path has the first stamp, but is known only now. It comes before the last pair, as
      // 'rosbag info' takes the end of the bag's last chunk for the end of the bag.
      writePath();
      write(*last_);
      // What ends the interval of the last pair.
      writeImu(last_->stamp_ns + kImuAfterLast_ns);
      writeWheels(last_->stamp_ns + kImuAfterLast_ns);
    }
    bag_.commit();
  }

 private:
  void begin(std::int64_t stamp_ns) {
    first_ns_ = stamp_ns;
    const ros::Time begin = StampShift(first_ns_).toRos(first_ns_);
    tf2_msgs::TFMessage transforms;
    transforms.transforms = toMountingTransforms(source_.calibration(), names_, begin);
    if (imu_) transforms.transforms.push_back(toImuTransform(imu_->T_imu_camera, names_, begin));
    if (wheels_)
      transforms.transforms.push_back(toWheelTransform(wheels_->T_body_camera, names_, begin));
    bag_.writeLatched("/tf_static", begin, transforms);
  }

  /// The samples from the first pair until a stamp that are not written yet.
  void writeImu(std::int64_t until_ns) {
    if (!imu_) return;
    for (; next_sample_ < imu_->samples.size(); ++next_sample_) {
      const ImuSample& sample = imu_->samples[next_sample_];
      if (sample.stamp_ns > until_ns) return;
      if (sample.stamp_ns < first_ns_ - kImuBeforeFirst_ns) continue;
      const ros::Time stamp = StampShift(first_ns_).toRos(sample.stamp_ns);
      bag_.write(name_space_ + "/imu", stamp, toImuMessage(sample, makeHeader(names_.imu, stamp)));
    }
  }

  /// As writeImu().
  void writeWheels(std::int64_t until_ns) {
    if (!wheels_) return;
    for (; next_pose_ < wheels_->samples.size(); ++next_pose_) {
      const OdometrySample& sample = wheels_->samples[next_pose_];
      if (sample.stamp_ns > until_ns) return;
      if (sample.stamp_ns < first_ns_ - kImuBeforeFirst_ns) continue;
      const ros::Time stamp = StampShift(first_ns_).toRos(sample.stamp_ns);
      const OdometrySample* before = next_pose_ > 0 ? &sample - 1 : nullptr;
      bag_.write(kWheelTopic, stamp, toWheelMessage(sample, before, names_, stamp));
    }
  }

  void write(const StereoImages& images) {
    writeImu(images.stamp_ns);
    writeWheels(images.stamp_ns);
    const ros::Time stamp = StampShift(first_ns_).toRos(images.stamp_ns);
    const StereoCalibration& calibration = source_.calibration();
    writeCamera("left", images.left, calibration.left, makeHeader(names_.left, stamp));
    writeCamera("right", images.right, calibration.right, makeHeader(names_.right, stamp));
    writeMask("left", images.left_mask, makeHeader(names_.left, stamp));
    writeMask("right", images.right_mask, makeHeader(names_.right, stamp));
  }

  void writePath() {
    const std::vector<StampedPose> ground_truth = source_.groundTruth();
    if (ground_truth.empty()) return;
    bag_.writeLatched("/ground_truth/path", StampShift(first_ns_).toRos(first_ns_),
                      makePath(ground_truth));
  }

  void writeCamera(const char* side, const cv::Mat& image, const CameraCalibration& calibration,
                   const std_msgs::Header& header) {
    bag_.write(name_space_ + "/" + side + "/camera_info", header.stamp,
               toCameraInfo(calibration, header));
    bag_.write(imageTopic(side), header.stamp, *toImageMessage(image, header));
  }

  void writeMask(const char* side, const cv::Mat& mask, const std_msgs::Header& header) {
    if (mask.empty()) return;
    bag_.write(name_space_ + "/" + side + "/mask_image", header.stamp,
               *toImageMessage(mask, header));
  }

  /// Poses of the base, relative to the one nearest to the first image, for the time of the images.
  nav_msgs::Path makePath(const std::vector<StampedPose>& ground_truth) const {
    const auto first = std::min_element(ground_truth.begin(), ground_truth.end(),
                                        [this](const StampedPose& a, const StampedPose& b) {
                                          return std::abs(a.stamp_ns - first_ns_) <
                                                 std::abs(b.stamp_ns - first_ns_);
                                        });
    const StampShift shift(first_ns_);
    nav_msgs::Path path;
    path.header = makeHeader(names_.odom, shift.toRos(first_ns_));
    for (auto pose = first; pose != ground_truth.end() && pose->stamp_ns <= last_->stamp_ns;
         ++pose) {
      geometry_msgs::PoseStamped stamped;
      stamped.header = makeHeader(names_.odom, shift.toRos(pose->stamp_ns));
      stamped.pose = toPose(toBasePose(first->T_world_camera.inverse() * pose->T_world_camera));
      path.poses.push_back(stamped);
    }
    return path;
  }

  static constexpr std::int64_t kImuBeforeFirst_ns = 100000000;
  static constexpr std::int64_t kImuAfterLast_ns = 100000000;

  const StereoSource& source_;
  const std::optional<ImuData> imu_;
  std::size_t next_sample_ = 0;
  const std::optional<WheelData> wheels_;
  std::size_t next_pose_ = 0;
  const CameraFrameNames names_;
  const std::string name_space_;
  BagFile bag_;
  std::optional<StereoImages> last_;  // not written yet
  std::int64_t first_ns_ = 0;
};

}  // namespace

void writeStereoBag(StereoSource& source, const StereoBagOptions& options) {
  StereoBag bag(options, source);
  const std::size_t num_pairs = expectedSize(source, options.max_frames);
  forEachPair(source, options.max_frames, options.quiet,
              [&bag](const StereoImages& images) { bag.add(images); });
  bag.commit();
  if (options.quiet) return;
  std::cout << num_pairs << " stereo pairs on " << bag.imageTopic("left") << " and "
            << bag.imageTopic("right") << '\n';
  if (bag.shifts()) {
    std::cout << "stamps begin at 0, which is no valid time in ROS: all are shifted by 1 s\n";
  }
}

}  // namespace point_line_odometry
