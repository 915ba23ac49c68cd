#pragma once

/// \file
/// Targets for a fuzzer: each feeds bytes to one kind of external input, and expects what the
/// functions that read it document: a valid value, or an exception of the documented type.
/// Anything else leaves the target as an exception, std::logic_error for a broken promise. Seeds
/// and inputs that once failed are in corpus/NAME, and fuzz_corpus_test runs all of them.

#include <array>
#include <cstddef>
#include <cstdint>

namespace point_line_odometry {

/// A serialised sensor_msgs/Image: toGray().
void fuzzImage(const std::uint8_t* data, std::size_t size);

/// Two serialised sensor_msgs/CameraInfo, left and right: toStereoCalibration(), rectifiedCamera()
/// and StereoRectifier.
void fuzzCameraInfo(const std::uint8_t* data, std::size_t size);

/// Parameters in a byte, and stereo frames with corrupted messages, as StereoInput,
/// SensorMounting and FrameProcessor get them from the nodelet's callbacks: nothing is thrown, and
/// the odometry is reset only if three messages in a row confirm the reason.
void fuzzStereoMessages(const std::uint8_t* data, std::size_t size);

/// A text: readTum(), and the output of writeTum() is read back unchanged.
void fuzzTrajectory(const std::uint8_t* data, std::size_t size);

/// A text whose first line names a file of a KITTI folder (calib.txt, times.txt, poses.txt,
/// timestamps.txt or packet.txt of oxts, calib_imu_to_velo.txt), the rest is its content:
/// StereoDataset.
void fuzzKitti(const std::uint8_t* data, std::size_t size);

/// The same with a file of an EuRoC folder: sensor.yaml (of the left camera), data.csv (of the left
/// camera), groundtruth.csv, imu.csv or imu.yaml.
void fuzzEuroc(const std::uint8_t* data, std::size_t size);

/// A text: readPriors().
void fuzzPriors(const std::uint8_t* data, std::size_t size);

/// A text: readCameraInfo(), and the output of formatCameraInfo() is read back unchanged.
void fuzzCameraInfoFile(const std::uint8_t* data, std::size_t size);

/// A mask file: StaticMasks. The same bytes, of which the first four are encoding, width, height
/// and step, as a message: toMask().
void fuzzMask(const std::uint8_t* data, std::size_t size);

/// A text as YAML file: loadParameters(). Its lines as settings name=value: applySettings().
void fuzzConfiguration(const std::uint8_t* data, std::size_t size);

/// Lines "T name=value" with the type T of the value (b, i, d, s, a for an array, t for a struct
/// in which "value" is true) as tree of private ROS parameters: parseParameters().
void fuzzRosParameters(const std::uint8_t* data, std::size_t size);

struct FuzzTarget {
  const char* name;  ///< of its folder in corpus/
  void (*run)(const std::uint8_t* data, std::size_t size);
};

constexpr std::array<FuzzTarget, 11> kFuzzTargets{{
    {"image", fuzzImage},
    {"camera_info", fuzzCameraInfo},
    {"camera_info_file", fuzzCameraInfoFile},
    {"stereo_messages", fuzzStereoMessages},
    {"trajectory", fuzzTrajectory},
    {"kitti", fuzzKitti},
    {"euroc", fuzzEuroc},
    {"priors", fuzzPriors},
    {"mask", fuzzMask},
    {"configuration", fuzzConfiguration},
    {"ros_parameters", fuzzRosParameters},
}};

}  // namespace point_line_odometry
