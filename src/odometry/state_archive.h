#pragma once

/// \file
/// Serialization of the state of the odometry. A type of the state names its members by a function
/// state() of its own or by stateOf() here. Both unpack the type by a structured binding, so that a
/// member that is added and not named does not compile.

#include <Eigen/Geometry>
#include <array>
#include <cstdint>
#include <cstring>
#include <deque>
#include <opencv2/core/mat.hpp>
#include <optional>
#include <stdexcept>
#include <string>
#include <tuple>
#include <type_traits>
#include <utility>
#include <vector>

#include "features/features.h"
#include "map/landmarks.h"
#include "matching/stereo_frame.h"
#include "motion/correspondence.h"
#include "odometry/odometry_state.h"
#include "odometry/pose_integrator.h"
#include "point_line_odometry/types.h"

namespace point_line_odometry {

template <int kSize, int kDof>
auto stateOf(GaussianEstimate<kSize, kDof>& estimate) {
  auto& [value, sqrt_covariance] = estimate;
  return std::tie(value, sqrt_covariance);
}

inline auto stateOf(TrackStatistics& statistics) {
  auto& [seen, missed, last_keyframe] = statistics;
  return std::tie(seen, missed, last_keyframe);
}

inline auto stateOf(MapPoint& point) {
  auto& [id, estimate, statistics, octave, patch_axes, patch, left, right] = point;
  return std::tie(id, estimate, statistics, octave, patch_axes, patch, left, right);
}

inline auto stateOf(MapLine& line) {
  auto& [id, estimate, statistics, left, right] = line;
  return std::tie(id, estimate, statistics, left, right);
}

inline auto stateOf(PointObservation& observation) {
  auto& [left_px, right_px, sigma_px, patch_px] = observation;
  return std::tie(left_px, right_px, sigma_px, patch_px);
}

inline auto stateOf(LineObservation& observation) {
  auto& [left_start_px, left_end_px, right_start_px, right_end_px, sigma_px] = observation;
  return std::tie(left_start_px, left_end_px, right_start_px, right_end_px, sigma_px);
}

inline auto stateOf(Keypoint& feature) {
  auto& [pixel, angle_rad, response, octave, descriptor] = feature;
  return std::tie(pixel, angle_rad, response, octave, descriptor);
}

inline auto stateOf(LineSegment& segment) {
  auto& [start, end] = segment;
  return std::tie(start, end);
}

inline auto stateOf(LineFeature& feature) {
  auto& [segment, descriptor, scale] = feature;
  return std::tie(segment, descriptor, scale);
}

inline auto stateOf(DetectedFeatures& features) {
  auto& [points_left, points_right, lines_left, lines_right] = features;
  return std::tie(points_left, points_right, lines_left, lines_right);
}

inline auto stateOf(TriangulatedPoint& point) {
  auto& [p_camera, covariance] = point;
  return std::tie(p_camera, covariance);
}

inline auto stateOf(TriangulatedLine& line) {
  auto& [start_camera, end_camera, covariance] = line;
  return std::tie(start_camera, end_camera, covariance);
}

inline auto stateOf(StereoPoint& point) {
  auto& [left, right, right_px, sigma_px, slope, triangulated, far] = point;
  return std::tie(left, right, right_px, sigma_px, slope, triangulated, far);
}

inline auto stateOf(StereoLine& line) {
  auto& [left, right, triangulated] = line;
  return std::tie(left, right, triangulated);
}

inline auto stateOf(ImagePyramid& pyramid) {
  auto& [levels] = pyramid;
  return std::tie(levels);
}

inline auto stateOf(StereoFrame& frame) {
  auto& [stamp_ns, left_image, features, correction, shutter, points, lines, resting] = frame;
  return std::tie(stamp_ns, left_image, features, correction, shutter, points, lines, resting);
}

inline auto stateOf(CameraVelocity& velocity) {
  auto& [value, covariance, measured_over_s, stamp_ns, is_current, since_previous] = velocity;
  return std::tie(value, covariance, measured_over_s, stamp_ns, is_current, since_previous);
}

inline auto stateOf(ImageMotion& motion) {
  auto& [from_ns, T_prev_curr, covariance] = motion;
  return std::tie(from_ns, T_prev_curr, covariance);
}

inline auto stateOf(MotionPrior& prior) {
  auto& [from_ns, to_ns, T_prev_curr, information] = prior;
  return std::tie(from_ns, to_ns, T_prev_curr, information);
}

template <typename Type>
auto stateOf(Type& object) -> decltype(object.state()) {
  return object.state();
}

/// Visits the members of a value recursively, for writing and reading. `Direction` has bytes(data,
/// size) for memory, and count(n) for the number of elements that follow.
template <typename Direction>
class StateArchive : public Direction {
 public:
  using Direction::Direction;

  template <typename T>
  void visit(T& value) {
    if constexpr (std::is_arithmetic_v<T> || std::is_enum_v<T>) {
      Direction::bytes(&value, sizeof(T));
    } else {
      visitMembers(stateOf(value),
                   std::make_index_sequence<std::tuple_size_v<decltype(stateOf(value))>>());
    }
  }

  template <typename Scalar, int kRows, int kColumns>
  void visit(Eigen::Matrix<Scalar, kRows, kColumns>& matrix) {
    static_assert(kRows != Eigen::Dynamic && kColumns != Eigen::Dynamic);
    Direction::bytes(matrix.data(), sizeof(Scalar) * kRows * kColumns);
  }

  void visit(Eigen::Isometry3d& T) { visit(T.matrix()); }

  template <typename T, std::size_t kSize>
  void visit(std::array<T, kSize>& values) {
    static_assert(std::is_arithmetic_v<T>);
    Direction::bytes(values.data(), sizeof(values));
  }

  template <typename T>
  void visit(std::vector<T>& values) {
    visitElements(values);
  }

  template <typename T>
  void visit(std::deque<T>& values) {
    visitElements(values);
  }

  template <typename T>
  void visit(std::optional<T>& value) {
    if (Direction::count(value ? 1 : 0) == 0) {
      value.reset();
    } else {
      if (!value) value.emplace();
      visit(*value);
    }
  }

  /// \param image CV_8UC1.
  void visit(cv::Mat& image) {
    int size[2] = {image.rows, image.cols};
    Direction::bytes(size, sizeof(size));
    Direction::resize(size, &image);
    for (int v = 0; v < image.rows; ++v)
      Direction::bytes(image.ptr(v), static_cast<std::size_t>(image.cols));
  }

 private:
  template <typename Container>
  void visitElements(Container& values) {
    // One by one: a damaged count must not allocate more than there are bytes for.
    const std::size_t size = Direction::count(values.size());
    if (values.size() > size) values.resize(size);
    for (std::size_t i = 0; i < size; ++i) {
      if (i == values.size()) values.emplace_back();
      visit(values[i]);
    }
  }

  template <typename Members, std::size_t... kIndices>
  void visitMembers(Members members, std::index_sequence<kIndices...>) {
    Direction::mark(sizeof...(kIndices));
    (visit(std::get<kIndices>(members)), ...);
  }
};

/// Writes values as bytes.
class ToBytes {
 public:
  std::string take() { return std::move(written_); }

 protected:
  void bytes(const void* data, std::size_t size) {
    written_.append(static_cast<const char*>(data), size);
  }
  std::size_t count(std::uint64_t n) {
    bytes(&n, sizeof(n));
    return n;
  }
  void mark(std::uint8_t num_members) { bytes(&num_members, 1); }
  static void resize(const int*, cv::Mat*) {}

 private:
  std::string written_;
};

/// Reads values from bytes. Throws std::invalid_argument if the bytes end early or have another
/// layout.
class FromBytes {
 public:
  /// \param bytes must outlive this.
  explicit FromBytes(const std::string& bytes) : data_(bytes.data()), left_(bytes.size()) {}

  void requireEnd() const {
    if (left_ > 0) refuse();
  }

 protected:
  void bytes(void* data, std::size_t size) {
    if (size > left_) refuse();
    std::memcpy(data, data_, size);
    data_ += size;
    left_ -= size;
  }
  std::size_t count(std::uint64_t) {
    std::uint64_t n = 0;
    bytes(&n, sizeof(n));
    if (n > left_) refuse();  // every element takes a byte at least
    return n;
  }
  void mark(std::uint8_t num_members) {
    std::uint8_t written = 0;
    bytes(&written, 1);
    if (written != num_members) refuse();
  }
  void resize(const int* size, cv::Mat* image) const {
    const bool fits = size[0] >= 0 && size[1] >= 0 &&
                      static_cast<double>(size[0]) * size[1] <= static_cast<double>(left_);
    if (!fits) refuse();
    image->create(size[0], size[1], CV_8UC1);
  }

 private:
  [[noreturn]] static void refuse() {
    throw std::invalid_argument(
        "the state of the odometry is damaged: it ends early or has impossible sizes");
  }

  const char* data_;
  std::size_t left_;
};

/// The whole state as bytes: after a hundred frames of KITTI 8 MB in 2 ms.
std::string toBytes(OdometryState& state);

/// Throws std::invalid_argument, and leaves an invalid state, if the bytes are not complete or of
/// another layout.
void fromBytes(const std::string& bytes, OdometryState* state);

}  // namespace point_line_odometry
