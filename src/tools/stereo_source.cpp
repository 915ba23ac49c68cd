#include "tools/stereo_source.h"

#include <utility>

#include "dataset/dataset.h"
#include "geometry/camera_axes.h"
#include "tools/interruption.h"
#include "tools/progress_bar.h"

namespace point_line_odometry {
namespace {

class FolderSource : public StereoSource {
 public:
  explicit FolderSource(StereoDataset dataset) : dataset_(std::move(dataset)) {}

  std::size_t size() const override { return dataset_.size(); }
  const StereoCalibration& calibration() const override { return dataset_.calibration(); }
  bool needsRectification() const override { return dataset_.needsRectification(); }
  std::vector<StampedPose> groundTruth() const override { return dataset_.groundTruth(); }
  std::optional<ImuData> imu() override { return dataset_.readImu(); }

  std::optional<StereoImages> next() override {
    if (next_ >= dataset_.size()) return std::nullopt;
    return dataset_.load(next_++);
  }

  bool skip() override { return next_ < dataset_.size() && ++next_ > 0; }

 private:
  StereoDataset dataset_;
  std::size_t next_ = 0;
};

}  // namespace

Eigen::Isometry3d StereoSource::T_base_camera() {
  Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
  T.linear() = cameraAxesInBody();
  return T;
}

std::unique_ptr<StereoSource> openFolder(const std::string& folder) {
  return std::make_unique<FolderSource>(StereoDataset::open(folder));
}

std::size_t expectedSize(const StereoSource& source, std::size_t limit) {
  return limit > 0 && limit < source.size() ? limit : source.size();
}

void forEachPair(StereoSource& source, std::size_t limit, bool quiet,
                 const std::function<void(const StereoImages&)>& take) {
  ProgressBar progress("stereo pairs", expectedSize(source, limit), quiet);
  for (std::size_t done = 0; limit == 0 || done < limit; ++done) {
    throwIfInterrupted();
    const std::optional<StereoImages> images = source.next();
    if (!images) return;
    take(*images);
    progress.step();
  }
}

}  // namespace point_line_odometry
