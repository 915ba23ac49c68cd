/// \file
/// Writes a KITTI or EuRoC folder to a bag that stereo nodes can take: images, camera_info, static
/// transforms and, where there is one, the ground truth as a path.
///
/// base_link (x forward, y left, z up) lies at the centre of the left camera, for both kinds of
/// data sets; base_link -> left_camera is only the rotation from body to optical axes. For raw
/// images (EuRoC) left_camera is the camera that took the images, before rectification.

#include <nav_msgs/Path.h>
#include <ros/names.h>
#include <rosbag/bag.h>
#include <tf2_msgs/TFMessage.h>

#include <algorithm>
#include <cstdlib>
#include <filesystem>
#include <iostream>

#include "ros/conversions.h"
#include "tools/command_line.h"
#include "tools/progress_bar.h"

namespace point_line_odometry {
namespace {

namespace po = boost::program_options;

constexpr std::int64_t kSecond_ns = 1000000000;
constexpr const char* kLeftFrame = "left_camera";
constexpr const char* kRightFrame = "right_camera";

struct Options {
  std::string dataset;
  std::string bag;
  std::string name_space = "stereo";
  std::string compression = "none";
  long max_frames = 0;  // 0: all
  bool quiet = false;
};

/// A bag that gets its name when it is whole; without commit() nothing is left of it.
class BagFile {
 public:
  BagFile(const std::string& file, rosbag::CompressionType compression)
      : file_(file), part_(file + ".part") {
    try {
      bag_.open(part_, rosbag::bagmode::Write);
    } catch (const rosbag::BagException&) {
      throw InputError("bag '" + file + "' cannot be written: give a file in a folder that is " +
                       "there and that you may write to");
    }
    bag_.setCompression(compression);
  }

  ~BagFile() {
    if (committed_) return;
    try {
      bag_.close();
    } catch (const rosbag::BagException&) {
      // It is thrown away anyway.
    }
    std::error_code ignored;
    std::filesystem::remove(part_, ignored);
  }
  BagFile(const BagFile&) = delete;
  BagFile& operator=(const BagFile&) = delete;

  template <typename Message>
  void write(const std::string& topic, const ros::Time& stamp, const Message& message) {
    bag_.write(topic, stamp, message);
  }

  /// Writes a message that a player publishes latched.
  template <typename Message>
  void writeLatched(const std::string& topic, const ros::Time& stamp, const Message& message) {
    const auto header = boost::make_shared<ros::M_string>();
    (*header)["topic"] = topic;
    (*header)["type"] = ros::message_traits::datatype(message);
    (*header)["md5sum"] = ros::message_traits::md5sum(message);
    (*header)["message_definition"] = ros::message_traits::definition(message);
    (*header)["callerid"] = "/dataset_to_bag";
    (*header)["latching"] = "1";
    bag_.write(topic, stamp, message, header);
  }

  void commit() {
    bag_.close();
    std::error_code error;
    std::filesystem::rename(part_, file_, error);
    if (error) {
      throw InputError("bag '" + file_ + "' cannot be written (" + error.message() +
                       "): give another name");
    }
    committed_ = true;
  }

 private:
  std::string file_;
  std::string part_;
  rosbag::Bag bag_;
  bool committed_ = false;
};

/// Shifts stamps of data sets that begin at 0, which is no time in ROS.
class Clock {
 public:
  explicit Clock(std::int64_t first_stamp_ns)
      : shift_ns_(first_stamp_ns < kSecond_ns ? kSecond_ns : 0) {}

  bool shifts() const { return shift_ns_ > 0; }

  ros::Time time(std::int64_t stamp_ns) const {
    ros::Time time;
    time.fromNSec(static_cast<std::uint64_t>(stamp_ns + shift_ns_));
    return time;
  }

 private:
  std::int64_t shift_ns_;
};

std_msgs::Header makeHeader(const std::string& frame, const ros::Time& stamp) {
  std_msgs::Header header;
  header.stamp = stamp;
  header.frame_id = frame;
  return header;
}

/// Axes of the camera (x right, y down, z forward) in base_link (x forward, y left, z up).
Eigen::Isometry3d poseOfCameraInBase() {
  Eigen::Matrix3d R_base_camera;
  R_base_camera << 0.0, 0.0, 1.0, -1.0, 0.0, 0.0, 0.0, -1.0, 0.0;
  Eigen::Isometry3d T_base_camera = Eigen::Isometry3d::Identity();
  T_base_camera.linear() = R_base_camera;
  return T_base_camera;
}

/// Pose of the right camera in the left one, of the cameras that took the images.
Eigen::Isometry3d poseOfRightInLeft(const StereoCalibration& calibration) {
  Eigen::Isometry3d T_rectified_left = Eigen::Isometry3d::Identity();
  Eigen::Isometry3d T_rectified_right = Eigen::Isometry3d::Identity();
  T_rectified_left.linear() = calibration.left.R;
  T_rectified_right.linear() = calibration.right.R;
  T_rectified_right.translation().x() = rectifiedCamera(calibration).baseline_m;
  return T_rectified_left.inverse() * T_rectified_right;
}

geometry_msgs::TransformStamped makeTransform(const std_msgs::Header& parent,
                                              const std::string& child,
                                              const Eigen::Isometry3d& T_parent_child) {
  geometry_msgs::TransformStamped transform;
  transform.header = parent;
  transform.child_frame_id = child;
  transform.transform = toTransform(T_parent_child);
  return transform;
}

/// Poses of base_link, relative to the one nearest to the first image, for the time of the images.
nav_msgs::Path makePath(const StereoDataset& dataset, std::size_t num_frames, const Clock& clock) {
  const std::vector<StampedPose>& poses = dataset.groundTruth();
  const std::int64_t first_ns = dataset.frame(0).stamp_ns;
  const std::int64_t last_ns = dataset.frame(num_frames - 1).stamp_ns;
  const auto first = std::min_element(
      poses.begin(), poses.end(), [first_ns](const StampedPose& a, const StampedPose& b) {
        return std::abs(a.stamp_ns - first_ns) < std::abs(b.stamp_ns - first_ns);
      });
  const Eigen::Isometry3d T_base_camera = poseOfCameraInBase();
  nav_msgs::Path path;
  path.header = makeHeader("odom", clock.time(first_ns));
  for (auto pose = first; pose != poses.end() && pose->stamp_ns <= last_ns; ++pose) {
    const Eigen::Isometry3d T_first_camera = first->T_world_camera.inverse() * pose->T_world_camera;
    geometry_msgs::PoseStamped stamped;
    stamped.header = makeHeader("odom", clock.time(pose->stamp_ns));
    stamped.pose = toPose(T_base_camera * T_first_camera * T_base_camera.inverse());
    path.poses.push_back(stamped);
  }
  return path;
}

sensor_msgs::Image makeImage(const cv::Mat& image, const std_msgs::Header& header) {
  sensor_msgs::Image message;
  message.header = header;
  message.width = static_cast<std::uint32_t>(image.cols);
  message.height = static_cast<std::uint32_t>(image.rows);
  message.encoding = "mono8";
  message.step = message.width;
  const cv::Mat continuous = image.isContinuous() ? image : image.clone();
  message.data.assign(continuous.data, continuous.data + continuous.total());
  return message;
}

void writeStatics(const StereoDataset& dataset, std::size_t num_frames, const Clock& clock,
                  BagFile* bag) {
  const ros::Time begin = clock.time(dataset.frame(0).stamp_ns);
  tf2_msgs::TFMessage transforms;
  transforms.transforms = {
      makeTransform(makeHeader("base_link", begin), kLeftFrame, poseOfCameraInBase()),
      makeTransform(makeHeader(kLeftFrame, begin), kRightFrame,
                    poseOfRightInLeft(dataset.calibration()))};
  bag->writeLatched("/tf_static", begin, transforms);
  if (dataset.groundTruth().empty()) return;
  bag->writeLatched("/ground_truth/path", begin, makePath(dataset, num_frames, clock));
}

/// Image and camera_info of one camera.
struct CameraTopics {
  std::string image;
  std::string info;
};

CameraTopics nameTopics(const Options& options, const char* side, const StereoDataset& dataset) {
  const std::string camera = options.name_space + "/" + side;
  return {camera + (dataset.needsRectification() ? "/image_raw" : "/image_rect"),
          camera + "/camera_info"};
}

void writeCamera(const CameraTopics& topics, const cv::Mat& image,
                 const CameraCalibration& calibration, const std_msgs::Header& header,
                 BagFile* bag) {
  bag->write(topics.info, header.stamp, toCameraInfo(calibration, header));
  bag->write(topics.image, header.stamp, makeImage(image, header));
}

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

int convert(Options options) {
  const rosbag::CompressionType compression = toCompression(options.compression);
  options.name_space = normalizeNamespace(options.name_space);
  const StereoDataset dataset = StereoDataset::open(options.dataset);
  const std::size_t num_frames =
      options.max_frames > 0
          ? std::min(dataset.size(), static_cast<std::size_t>(options.max_frames))
          : dataset.size();
  const Clock clock(dataset.frame(0).stamp_ns);
  const CameraTopics left = nameTopics(options, "left", dataset);
  const CameraTopics right = nameTopics(options, "right", dataset);

  BagFile bag(options.bag, compression);
  writeStatics(dataset, num_frames, clock, &bag);
  {
    ProgressBar progress("dataset_to_bag", num_frames, options.quiet);
    for (std::size_t i = 0; i < num_frames; ++i) {
      const StereoImages images = dataset.load(i);
      const ros::Time stamp = clock.time(images.stamp_ns);
      const StereoCalibration& calibration = dataset.calibration();
      writeCamera(left, images.left, calibration.left, makeHeader(kLeftFrame, stamp), &bag);
      writeCamera(right, images.right, calibration.right, makeHeader(kRightFrame, stamp), &bag);
      progress.step();
    }
  }
  bag.commit();
  if (!options.quiet) {
    std::cout << num_frames << " stereo pairs on " << left.image << " and " << right.image << '\n';
    if (clock.shifts()) {
      std::cout << "stamps begin at 0, which is no time in ROS: all are shifted by 1 s\n";
    }
  }
  return 0;
}

int runCommandLine(int argc, char** argv) {
  Options options;
  po::options_description visible("Options");
  // clang-format off
  visible.add_options()
      ("namespace", po::value(&options.name_space)->value_name("NS")->default_value("stereo"),
       "name space of the images")
      ("compression", po::value(&options.compression)->value_name("KIND")->default_value("none"),
       "none, lz4 or bz2")
      ("max-frames", po::value(&options.max_frames)->value_name("N"), "stop after N frames")
      ("quiet", po::bool_switch(&options.quiet), "no progress bar and no text")
      ("help,h", "print this help and end");
  // clang-format on
  po::options_description all(visible);
  all.add_options()("dataset", po::value(&options.dataset))("bag", po::value(&options.bag));
  const po::variables_map values = parseArguments(argc, argv, all, {"dataset", "bag"});
  if (values.count("help") > 0) {
    std::cout << "usage: dataset_to_bag DATASET OUT.bag [options]\n\n"
                 "Writes the folder of a KITTI or EuRoC sequence to a bag:\n"
                 "  NS/left|right/image_rect (KITTI) or image_raw (EuRoC), mono8\n"
                 "  NS/left|right/camera_info   K, D, R and P of each camera\n"
                 "  /tf_static                  base_link -> left_camera -> right_camera\n"
                 "  /ground_truth/path          poses of base_link in odom, if there are any\n"
                 "base_link lies in the left camera, with x forward, y left and z up.\n\n"
              << visible;
    return 0;
  }
  if (options.dataset.empty()) throw InputError("no data set is given: name its folder");
  if (options.bag.empty()) throw InputError("no bag is given: name the file to be written");
  requirePositive("--max-frames", options.max_frames, values);
  return convert(options);
}

}  // namespace
}  // namespace point_line_odometry

int main(int argc, char** argv) {
  return point_line_odometry::runTool(
      "dataset_to_bag", [&] { return point_line_odometry::runCommandLine(argc, argv); });
}
