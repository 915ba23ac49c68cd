#pragma once

#include <nav_msgs/Path.h>
#include <ros/names.h>
#include <tf2_msgs/TFMessage.h>

#include <algorithm>
#include <cstdlib>
#include <iostream>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "ros/bag_file.h"
#include "ros/camera_messages.h"
#include "ros/conversions.h"
#include "tools/stereo_source.h"

namespace point_line_odometry {

/// Where and how a stereo bag is written.
struct StereoBagOptions {
  std::string file;
  std::string name_space = "stereo";
  std::string compression = "none";
  std::size_t max_frames = 0;  ///< 0: all
  bool quiet = false;
};

/// A bag that stereo nodes can take: images, camera_info, static transforms and, where it is known,
/// the ground truth as a path.
class StereoBag {
 public:
  /// \param source calibration and truth are taken from it; it must outlive the bag. Throws
  /// InputError for bad options.
  StereoBag(const StereoBagOptions& options, const StereoSource& source)
      : source_(source),
        name_space_(normalizeNamespace(options.name_space)),
        bag_(options.file, toCompression(options.compression), "/dataset_to_bag") {}

  std::string imageTopic(const char* side) const {
    return name_space_ + "/" + side + "/" + imageTopicName(source_.needsRectification());
  }

  /// True if stamps are not as in the source, since these begin at 0.
  bool shifts() const { return StampShift(first_ns_).shifts(); }

  void add(StereoImages images) {
    if (!last_) begin(images.stamp_ns);
    if (last_) write(*last_);
    last_ = std::move(images);
  }

  /// Writes what is left and gives the bag its name.
  void commit() {
    if (last_) {
      // The path has the first stamp, but is known only now. It comes before the last pair, as
      // 'rosbag info' takes the end of the bag's last chunk for the end of the bag.
      writePath();
      write(*last_);
    }
    bag_.commit();
  }

 private:
  static rosbag::CompressionType toCompression(const std::string& name) {
    if (name == "none") return rosbag::compression::Uncompressed;
    if (name == "lz4") return rosbag::compression::LZ4;
    if (name == "bz2") return rosbag::compression::BZ2;
    throw InputError("compression '" + name + "' is unknown: choose none, lz4 or bz2");
  }

  /// The name space as "/a/b", "" for the root.
  static std::string normalizeNamespace(std::string name) {
    name.erase(0, name.find_first_not_of('/'));
    while (!name.empty() && name.back() == '/') name.pop_back();
    std::string error;
    if (!name.empty() && !ros::names::validate(name, error)) {
      throw InputError("name space '" + name + "' is no name in ROS: use letters, digits, _ and /");
    }
    return name.empty() ? "" : "/" + name;
  }

  void begin(std::int64_t stamp_ns) {
    first_ns_ = stamp_ns;
    const ros::Time begin = StampShift(first_ns_).toRos(first_ns_);
    tf2_msgs::TFMessage transforms;
    transforms.transforms = toMountingTransforms(source_.calibration(), names_, begin);
    bag_.writeLatched("/tf_static", begin, transforms);
  }

  void write(const StereoImages& images) {
    const ros::Time stamp = StampShift(first_ns_).toRos(images.stamp_ns);
    const StereoCalibration& calibration = source_.calibration();
    writeCamera("left", images.left, calibration.left, makeHeader(names_.left, stamp));
    writeCamera("right", images.right, calibration.right, makeHeader(names_.right, stamp));
  }

  void writePath() {
    const std::vector<StampedPose> truth = source_.groundTruth();
    if (truth.empty()) return;
    bag_.writeLatched("/ground_truth/path", StampShift(first_ns_).toRos(first_ns_),
                      makePath(truth));
  }

  void writeCamera(const char* side, const cv::Mat& image, const CameraCalibration& calibration,
                   const std_msgs::Header& header) {
    bag_.write(name_space_ + "/" + side + "/camera_info", header.stamp,
               toCameraInfo(calibration, header));
    bag_.write(imageTopic(side), header.stamp, *toImageMessage(image, header));
  }

  /// Poses of the base, relative to the one nearest to the first image, for the time of the images.
  nav_msgs::Path makePath(const std::vector<StampedPose>& truth) const {
    const auto first = std::min_element(
        truth.begin(), truth.end(), [this](const StampedPose& a, const StampedPose& b) {
          return std::abs(a.stamp_ns - first_ns_) < std::abs(b.stamp_ns - first_ns_);
        });
    const StampShift shift(first_ns_);
    nav_msgs::Path path;
    path.header = makeHeader(names_.odom, shift.toRos(first_ns_));
    for (auto pose = first; pose != truth.end() && pose->stamp_ns <= last_->stamp_ns; ++pose) {
      geometry_msgs::PoseStamped stamped;
      stamped.header = makeHeader(names_.odom, shift.toRos(pose->stamp_ns));
      stamped.pose = toPose(toBasePose(first->T_world_camera.inverse() * pose->T_world_camera));
      path.poses.push_back(stamped);
    }
    return path;
  }

  const StereoSource& source_;
  const CameraFrameNames names_;
  const std::string name_space_;
  BagFile bag_;
  std::optional<StereoImages> last_;  // not written yet
  std::int64_t first_ns_ = 0;
};

/// Writes the pairs of a source to a bag and says where they are. Throws InputError for bad options
/// and what cannot be read or written.
inline void writeStereoBag(StereoSource& source, const StereoBagOptions& options) {
  StereoBag bag(options, source);
  const std::size_t num_pairs = expectedSize(source, options.max_frames);
  {
    ProgressBar progress("stereo pairs", num_pairs, options.quiet);
    forEachPair(source, options.max_frames, &progress,
                [&bag](const StereoImages& images) { bag.add(images); });
  }
  bag.commit();
  if (options.quiet) return;
  std::cout << num_pairs << " stereo pairs on " << bag.imageTopic("left") << " and "
            << bag.imageTopic("right") << '\n';
  if (bag.shifts()) {
    std::cout << "stamps begin at 0, which is no time in ROS: all are shifted by 1 s\n";
  }
}

}  // namespace point_line_odometry
