#include "tools/source_filters.h"

#include <algorithm>
#include <cmath>
#include <opencv2/core.hpp>
#include <optional>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "common/image_resize.h"
#include "common/input_error.h"
#include "dataset/camera_info_file.h"

namespace point_line_odometry {
namespace {

/// A source that changes what another one gives. Whatever a filter does not override is that of the
/// other one.
class SourceFilter : public StereoSource {
 public:
  explicit SourceFilter(std::unique_ptr<StereoSource> source) : source_(std::move(source)) {}

  std::size_t size() const override { return source_->size(); }
  const StereoCalibration& calibration() const override { return source_->calibration(); }
  bool needsRectification() const override { return source_->needsRectification(); }
  std::size_t unsynchronized() const override { return source_->unsynchronized(); }
  std::vector<std::string> warnings() const override { return source_->warnings(); }
  std::vector<StampedPose> groundTruth() const override { return source_->groundTruth(); }
  std::optional<ImuData> imu() override { return source_->imu(); }
  std::optional<WheelData> wheels() override { return source_->wheels(); }
  Eigen::Isometry3d T_base_camera() override { return source_->T_base_camera(); }
  bool skip() override { return source_->skip(); }

 protected:
  StereoSource& source() { return *source_; }
  const StereoSource& source() const { return *source_; }

 private:
  std::unique_ptr<StereoSource> source_;
};

class EveryNthSource : public SourceFilter {
 public:
  /// \param n at least 1.
  EveryNthSource(std::unique_ptr<StereoSource> source, std::size_t n)
      : SourceFilter(std::move(source)), n_(n) {}

  std::size_t size() const override { return (source().size() + n_ - 1) / n_; }
  bool skip() override { return next().has_value(); }

  std::optional<StereoImages> next() override {
    for (std::size_t i = 1; begun_ && i < n_; ++i) {
      if (!source().skip()) return std::nullopt;
    }
    begun_ = true;
    return source().next();
  }

 private:
  std::size_t n_;
  bool begun_ = false;
};

/// Whether rectification by this changes nothing: K = P, no distortion, no rotation.
bool isOfRectifiedImages(const CameraCalibration& camera) {
  constexpr double kSame_px = 1e-6;
  constexpr double kSame = 1e-9;
  const bool undistorted =
      std::all_of(camera.D.begin(), camera.D.end(), [](double d) { return std::abs(d) < kSame; });
  return undistorted && camera.R.isIdentity(kSame) &&
         (camera.K - camera.P.leftCols<3>()).cwiseAbs().maxCoeff() < kSame_px;
}

/// Rectified images may come without a K.
bool areOfRectifiedImages(const StereoCalibration& calibration) {
  const auto is = [](const CameraCalibration& camera) {
    return camera.K.isZero(0.0) || isOfRectifiedImages(camera);
  };
  return is(calibration.left) && is(calibration.right);
}

class CalibratedSource : public SourceFilter {
 public:
  CalibratedSource(std::unique_ptr<StereoSource> source, const CameraInfoFiles& files)
      : SourceFilter(std::move(source)), calibration_(this->source().calibration()) {
    const bool raw = this->source().needsRectification();
    if (!raw && !areOfRectifiedImages(calibration_)) {
      throw InputError(
          "camera_info files are of the images as the camera takes them, but these here were "
          "rectified from such: give the raw images");
    }
    replace(files[0], &calibration_.left);
    replace(files[1], &calibration_.right);
    needs_rectification_ = raw || !areOfRectifiedImages(calibration_);
    try {
      rectifiedCamera(calibration_);
      if (needs_rectification_) StereoRectifier{calibration_};
    } catch (const std::invalid_argument& error) {
      throw InputError(std::string("the camera_info files cannot be used: ") + error.what());
    }
  }

  const StereoCalibration& calibration() const override { return calibration_; }
  bool needsRectification() const override { return needs_rectification_; }
  std::optional<StereoImages> next() override { return source().next(); }

 private:
  static void replace(const std::string& file, CameraCalibration* camera) {
    if (file.empty()) return;
    const CameraCalibration given = readCameraInfo(file);
    if (given.width != camera->width || given.height != camera->height) {
      throw InputError("camera_info file '" + file + "' is for " + std::to_string(given.width) +
                       " x " + std::to_string(given.height) + ", but the images are " +
                       std::to_string(camera->width) + " x " + std::to_string(camera->height));
    }
    *camera = given;
  }

  StereoCalibration calibration_;
  bool needs_rectification_ = false;
};

class MaskedSource : public SourceFilter {
 public:
  MaskedSource(std::unique_ptr<StereoSource> source, const MaskRequest& request)
      : SourceFilter(std::move(source)), masks_(request.files), of_source_(request.of_source) {
    const std::string fault = masks_.sizeFault(this->source().calibration());
    if (!fault.empty()) throw InputError(fault);
  }

  std::optional<StereoImages> next() override {
    std::optional<StereoImages> images = source().next();
    if (!images) return std::nullopt;
    if (!of_source_) images->left_mask = images->right_mask = cv::Mat();
    masks_.addTo(&*images);
    return images;
  }

 private:
  StaticMasks masks_;
  bool of_source_;
};

/// The intrinsics of an image whose size is `factor` times as large. Pixel centres:
/// u becomes factor * (u + 0.5) - 0.5.
CameraCalibration scaledCalibration(CameraCalibration camera, double factor) {
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

class ScaledSource : public SourceFilter {
 public:
  /// \param factor of width and height.
  ScaledSource(std::unique_ptr<StereoSource> source, double factor)
      : SourceFilter(std::move(source)),
        calibration_{scaledCalibration(this->source().calibration().left, factor),
                     scaledCalibration(this->source().calibration().right, factor)} {}

  const StereoCalibration& calibration() const override { return calibration_; }

  std::optional<StereoImages> next() override {
    std::optional<StereoImages> images = source().next();
    if (!images) return std::nullopt;
    const cv::Size size(calibration_.left.width, calibration_.left.height);
    images->left = resized(images->left, size);
    images->right = resized(images->right, size);
    images->left_mask = resizedMask(images->left_mask, size);
    images->right_mask = resizedMask(images->right_mask, size);
    return images;
  }

 private:
  StereoCalibration calibration_;
};

}  // namespace

std::unique_ptr<StereoSource> everyNth(std::unique_ptr<StereoSource> source, std::size_t n) {
  if (n == 1) return source;
  return std::make_unique<EveryNthSource>(std::move(source), n);
}

std::unique_ptr<StereoSource> calibrated(std::unique_ptr<StereoSource> source,
                                         const CameraInfoFiles& files) {
  if (files[0].empty() && files[1].empty()) return source;
  return std::make_unique<CalibratedSource>(std::move(source), files);
}

std::unique_ptr<StereoSource> masked(std::unique_ptr<StereoSource> source,
                                     const MaskRequest& request) {
  return std::make_unique<MaskedSource>(std::move(source), request);
}

std::unique_ptr<StereoSource> scaled(std::unique_ptr<StereoSource> source, double factor) {
  return std::make_unique<ScaledSource>(std::move(source), factor);
}

}  // namespace point_line_odometry
