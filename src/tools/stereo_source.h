#pragma once

#include <optional>
#include <string>
#include <utility>

#include "point_line_odometry/dataset.h"

namespace point_line_odometry {

/// Stereo pairs in the order of time, from a folder or a bag.
class StereoSource {
 public:
  virtual ~StereoSource() = default;

  /// Number of pairs to be expected, for the progress bar.
  virtual std::size_t size() const = 0;
  virtual const StereoCalibration& calibration() const = 0;
  virtual bool needsRectification() const = 0;

  /// The next pair as stored, nothing at the end. Throws InputError for what cannot be read.
  virtual std::optional<StereoImages> next() = 0;

  /// Images passed over as they had no partner.
  virtual std::size_t unpaired() const { return 0; }
};

/// Pairs of a KITTI or EuRoC folder.
class FolderSource : public StereoSource {
 public:
  explicit FolderSource(StereoDataset dataset) : dataset_(std::move(dataset)) {}

  std::size_t size() const override { return dataset_.size(); }
  const StereoCalibration& calibration() const override { return dataset_.calibration(); }
  bool needsRectification() const override { return dataset_.needsRectification(); }

  std::optional<StereoImages> next() override {
    if (next_ >= dataset_.size()) return std::nullopt;
    return dataset_.load(next_++);
  }

 private:
  StereoDataset dataset_;
  std::size_t next_ = 0;
};

}  // namespace point_line_odometry
