#pragma once

#include <cstdint>
#include <vector>

#include "features/gradient.h"

namespace point_line_odometry {

/// Direction and strength of the gradient at a pixel in two bytes; 0 if it is no edge pixel. A
/// larger value is a stronger gradient.
class EdgePixel {
 public:
  EdgePixel() = default;
  explicit EdgePixel(std::uint16_t value) : value_(value) {}

  explicit operator bool() const { return value_ != 0; }
  /// Of the gradient, in 1/256 of a full turn from the x axis towards the y axis.
  std::uint8_t direction() const { return static_cast<std::uint8_t>(value_); }
  /// This pixel if the condition is true, else none; without a branch.
  EdgePixel onlyIf(bool condition) const {
    return EdgePixel(static_cast<std::uint16_t>(value_ & -static_cast<int>(condition)));
  }
  bool strongerThan(EdgePixel other) const { return value_ > other.value_; }

 private:
  std::uint16_t value_ = 0;
};

/// The pixels of an image whose gradient is strong enough for an edge. Edges are followed on this
/// map alone: it is a third of the gradient's memory, and directions are compared by one
/// subtraction.
///
/// A margin of kMargin pixels that are no edge surrounds the image, so that steps up to that length
/// need no test of the border. Pixels are identified by their index in the map.
class EdgeMap {
 public:
  static constexpr int kMargin = 8;
  static constexpr int kMinThreshold = 4;  ///< weaker edges are none in some directions

  /// \param threshold least strength of an edge [Sobel units], at least kMinThreshold.
  /// \param anchor_interval rows or columns between the anchors of an edge: no edge that is longer
  /// along its main axis is missed. \param allowed CV_8UC1, 0 where no edges are wanted, or empty.
  void compute(const GradientImage& gradient, int threshold, int anchor_interval,
               const cv::Mat& allowed = {});

  /// Pixels from which edges are followed: maxima of the gradient along the edge's normal, the
  /// strongest first. Of each edge only one pixel in `anchor_interval` is among them.
  const std::vector<std::int32_t>& anchors() const { return anchors_; }

  EdgePixel operator[](std::int32_t i) const { return EdgePixel(pixels_[i]); }
  void erase(std::int32_t i) { pixels_[i] = 0; }
  void eraseIf(bool condition, std::int32_t i) {
    pixels_[i] &= static_cast<std::uint16_t>(condition ? 0 : -1);
  }

  int column(std::int32_t i) const { return i % stride_ - kMargin; }
  int row(std::int32_t i) const { return i / stride_ - kMargin; }
  /// From a pixel to the one below it.
  std::int32_t stride() const { return stride_; }

 private:
  void collectAnchors(const GradientImage& gradient, int y);
  void eraseWhereZero(const cv::Mat& allowed);
  void sortAnchors();

  struct Candidate {
    std::int32_t index;
    int magnitude;
  };

  std::int32_t stride_ = 0;
  std::vector<std::uint16_t> pixels_;
  std::vector<std::uint8_t> is_anchor_;     // of one row
  std::vector<std::uint8_t> flat_columns_;  // 1 where flat edges may have anchors
  std::vector<Candidate> candidates_;       // in reading order
  std::vector<std::int32_t> anchors_;
};

}  // namespace point_line_odometry
