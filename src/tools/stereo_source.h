#pragma once

#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "point_line_odometry/dataset.h"
#include "tools/interruption.h"
#include "tools/progress_bar.h"

namespace point_line_odometry {

/// Stereo pairs in the order of time, from a folder, a bag or the synthetic world.
class StereoSource {
 public:
  virtual ~StereoSource() = default;

  /// Number of pairs to be expected, for the progress bar.
  virtual std::size_t size() const = 0;
  virtual const StereoCalibration& calibration() const = 0;
  virtual bool needsRectification() const = 0;

  /// The next pair as stored, nothing at the end. Throws InputError for what cannot be read.
  virtual std::optional<StereoImages> next() = 0;

  /// Passes over the next pair; false at the end.
  virtual bool skip() { return next().has_value(); }

  /// Images passed over as they had no partner.
  virtual std::size_t unpaired() const { return 0; }

  /// True poses of the left camera (the raw one for raw images), empty if they are not known.
  virtual std::vector<StampedPose> groundTruth() const { return {}; }
};

/// Pairs of a KITTI or EuRoC folder.
class FolderSource : public StereoSource {
 public:
  explicit FolderSource(StereoDataset dataset) : dataset_(std::move(dataset)) {}

  std::size_t size() const override { return dataset_.size(); }
  const StereoCalibration& calibration() const override { return dataset_.calibration(); }
  bool needsRectification() const override { return dataset_.needsRectification(); }
  std::vector<StampedPose> groundTruth() const override { return dataset_.groundTruth(); }

  std::optional<StereoImages> next() override {
    if (next_ >= dataset_.size()) return std::nullopt;
    return dataset_.load(next_++);
  }

  bool skip() override { return next_ < dataset_.size() && ++next_ > 0; }

 private:
  StereoDataset dataset_;
  std::size_t next_ = 0;
};

/// Number of pairs to be expected if at most `limit` are wanted (0: all).
inline std::size_t expectedSize(const StereoSource& source, std::size_t limit) {
  return limit > 0 && limit < source.size() ? limit : source.size();
}

/// Hands `limit` pairs (0: all) of a source to `take`, one after the other. Throws Interrupted as
/// soon as that is asked for.
template <typename Take>
void forEachPair(StereoSource& source, std::size_t limit, ProgressBar* progress, const Take& take) {
  for (std::size_t done = 0; limit == 0 || done < limit; ++done) {
    throwIfInterrupted();
    const std::optional<StereoImages> images = source.next();
    if (!images) return;
    take(*images);
    progress->step();
  }
}

}  // namespace point_line_odometry
