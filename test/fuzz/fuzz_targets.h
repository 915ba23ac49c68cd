#pragma once

/// \file
/// Targets for a fuzzer: each feeds bytes to one kind of input from outside, and expects what the
/// functions that read it promise: a value that can be used, or an exception of the promised type.
/// Anything else leaves the target as an exception, std::logic_error for a broken promise. Seeds
/// and inputs that once failed lie in corpus/NAME, and fuzz_corpus_test runs all of them.

#include <array>
#include <cstddef>
#include <cstdint>

namespace point_line_odometry {

/// A serialised sensor_msgs/Image: toGray().
void fuzzImage(const std::uint8_t* data, std::size_t size);

/// Two serialised sensor_msgs/CameraInfo, left and right: toStereoCalibration(), rectifiedCamera()
/// and StereoRectifier.
void fuzzCameraInfo(const std::uint8_t* data, std::size_t size);

/// Parameters in a byte, and stereo frames whose messages are spoiled, as StereoInput,
/// CameraMounting and FrameProcessor get them from the nodelet's callbacks: nothing is thrown, and
/// nothing begins anew that three messages in a row have not confirmed.
void fuzzStereoMessages(const std::uint8_t* data, std::size_t size);

/// A text: readTum(), and what writeTum() makes of it is read back as it was.
void fuzzTrajectory(const std::uint8_t* data, std::size_t size);

/// A text whose first line names a file of a KITTI folder (calib.txt, times.txt or poses.txt), the
/// rest is its content: StereoDataset.
void fuzzKitti(const std::uint8_t* data, std::size_t size);

/// The same with a file of an EuRoC folder: sensor.yaml (of the left camera), data.csv (of the left
/// camera) or groundtruth.csv.
void fuzzEuroc(const std::uint8_t* data, std::size_t size);

/// A text as YAML file: loadParameters(). Its lines as settings name=value: applySettings().
void fuzzConfiguration(const std::uint8_t* data, std::size_t size);

/// Lines "T name=value" with the type T of the value (b, i, d, s, a for an array, t for a struct
/// in which "value" is true) as tree of private ROS parameters: parseParameters().
void fuzzRosParameters(const std::uint8_t* data, std::size_t size);

struct FuzzTarget {
  const char* name;  ///< of its folder in corpus/
  void (*run)(const std::uint8_t* data, std::size_t size);
};

constexpr std::array<FuzzTarget, 8> kFuzzTargets{{
    {"image", fuzzImage},
    {"camera_info", fuzzCameraInfo},
    {"stereo_messages", fuzzStereoMessages},
    {"trajectory", fuzzTrajectory},
    {"kitti", fuzzKitti},
    {"euroc", fuzzEuroc},
    {"configuration", fuzzConfiguration},
    {"ros_parameters", fuzzRosParameters},
}};

}  // namespace point_line_odometry
