#pragma once

/// \file
/// Sources of stereo pairs made of others: fewer frames, other sizes.

#include <algorithm>
#include <cstddef>
#include <memory>
#include <opencv2/imgproc.hpp>
#include <optional>
#include <utility>
#include <vector>

#include "tools/stereo_source.h"

namespace point_line_odometry {

/// Every Nth pair of a source, from the first one on: a slow camera, or a computer that drops the
/// pairs between.
class EveryNthSource : public StereoSource {
 public:
  /// \param n at least 1.
  EveryNthSource(std::unique_ptr<StereoSource> source, std::size_t n)
      : source_(std::move(source)), n_(n) {}

  std::size_t size() const override { return (source_->size() + n_ - 1) / n_; }
  const StereoCalibration& calibration() const override { return source_->calibration(); }
  bool needsRectification() const override { return source_->needsRectification(); }
  std::size_t unpaired() const override { return source_->unpaired(); }
  std::vector<StampedPose> groundTruth() const override { return source_->groundTruth(); }
  bool skip() override { return next().has_value(); }

  std::optional<StereoImages> next() override {
    for (std::size_t i = 1; begun_ && i < n_; ++i) {
      if (!source_->skip()) return std::nullopt;
    }
    begun_ = true;
    return source_->next();
  }

 private:
  std::unique_ptr<StereoSource> source_;
  std::size_t n_;
  bool begun_ = false;
};

/// The intrinsics of an image whose size is `factor` times as large. Pixel centres: what lies at u
/// comes to factor * (u + 0.5) - 0.5.
inline CameraCalibration scaledCalibration(CameraCalibration camera, double factor) {
  const cv::Size size(cvRound(factor * camera.width), cvRound(factor * camera.height));
  const Eigen::Vector2d scale(static_cast<double>(size.width) / camera.width,
                              static_cast<double>(size.height) / camera.height);
  for (int row = 0; row < 2; ++row) {
    camera.K.row(row) *= scale[row];
    camera.P.row(row) *= scale[row];
    camera.K(row, 2) += 0.5 * scale[row] - 0.5;
    camera.P(row, 2) += 0.5 * scale[row] - 0.5;
  }
  camera.width = size.width;
  camera.height = size.height;
  return camera;
}

/// The pairs of a source in another size.
class ScaledSource : public StereoSource {
 public:
  /// \param factor of width and height.
  ScaledSource(std::unique_ptr<StereoSource> source, double factor)
      : source_(std::move(source)),
        calibration_{scaledCalibration(source_->calibration().left, factor),
                     scaledCalibration(source_->calibration().right, factor)} {}

  std::size_t size() const override { return source_->size(); }
  const StereoCalibration& calibration() const override { return calibration_; }
  bool needsRectification() const override { return source_->needsRectification(); }
  std::size_t unpaired() const override { return source_->unpaired(); }
  std::vector<StampedPose> groundTruth() const override { return source_->groundTruth(); }
  bool skip() override { return source_->skip(); }

  std::optional<StereoImages> next() override {
    std::optional<StereoImages> images = source_->next();
    if (!images) return std::nullopt;
    images->left = resized(images->left, calibration_.left);
    images->right = resized(images->right, calibration_.right);
    return images;
  }

 private:
  static cv::Mat resized(const cv::Mat& image, const CameraCalibration& camera) {
    cv::Mat result;
    const bool smaller = camera.width < image.cols;
    cv::resize(image, result, {camera.width, camera.height}, 0.0, 0.0,
               smaller ? cv::INTER_AREA : cv::INTER_CUBIC);
    return result;
  }

  std::unique_ptr<StereoSource> source_;
  StereoCalibration calibration_;
};

}  // namespace point_line_odometry
