#include "features/cv_orb_descriptor.h"

#include <cstring>

namespace point_line_odometry {
namespace {

constexpr int kPatch = 31;

/// One level, that of the image; no point is too near to the border.
cv::Ptr<cv::ORB> createOrb() {
  return cv::ORB::create(1, 1.2F, 1, 0, 0, 2, cv::ORB::HARRIS_SCORE, kPatch);
}

}  // namespace

CvOrbDescriptor::CvOrbDescriptor() : orb_(createOrb()) {}

void CvOrbDescriptor::describe(const cv::Mat& image, std::size_t begin,
                               std::vector<PointFeature>* features) {
  keypoints_.clear();
  for (std::size_t i = begin; i < features->size(); ++i) {
    const PointFeature& feature = (*features)[i];
    keypoints_.emplace_back(feature.pixel.x(), feature.pixel.y(), static_cast<float>(kPatch),
                            feature.angle_rad * static_cast<float>(180.0 / CV_PI), feature.response,
                            0);
  }
  if (keypoints_.empty()) return;
  orb_->compute(image, keypoints_, descriptors_);
  CV_Assert(static_cast<std::size_t>(descriptors_.rows) == features->size() - begin &&
            descriptors_.cols == sizeof(Descriptor));
  for (int row = 0; row < descriptors_.rows; ++row) {
    std::memcpy((*features)[begin + static_cast<std::size_t>(row)].descriptor.data(),
                descriptors_.ptr(row), sizeof(Descriptor));
  }
}

}  // namespace point_line_odometry
