#include "features/cv_orb_descriptor.h"

#include <cstring>

namespace point_line_odometry {
namespace {

constexpr int kPatch = 31;

/// One pyramid level, the image; no keypoint is dropped at the border.
cv::Ptr<cv::ORB> createOrb() {
  return cv::ORB::create(1, 1.2F, 1, 0, 0, 2, cv::ORB::HARRIS_SCORE, kPatch);
}

}  // namespace

CvOrbDescriptor::CvOrbDescriptor() : orb_(createOrb()) {}

void CvOrbDescriptor::describe(const cv::Mat& image, std::size_t begin,
                               std::vector<Keypoint>* keypoints) {
  keypoints_.clear();
  for (std::size_t i = begin; i < keypoints->size(); ++i) {
    const Keypoint& keypoint = (*keypoints)[i];
    keypoints_.emplace_back(keypoint.pixel.x(), keypoint.pixel.y(), static_cast<float>(kPatch),
                            keypoint.angle_rad * static_cast<float>(180.0 / CV_PI),
                            keypoint.response, 0);
  }
  if (keypoints_.empty()) return;
  orb_->compute(image, keypoints_, descriptors_);
  CV_Assert(static_cast<std::size_t>(descriptors_.rows) == keypoints->size() - begin &&
            descriptors_.cols == sizeof(Descriptor));
  for (int row = 0; row < descriptors_.rows; ++row) {
    std::memcpy((*keypoints)[begin + static_cast<std::size_t>(row)].descriptor.data(),
                descriptors_.ptr(row), sizeof(Descriptor));
  }
}

}  // namespace point_line_odometry
