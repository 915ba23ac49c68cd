#pragma once

#include <Eigen/Core>
#include <memory>
#include <opencv2/core.hpp>
#include <vector>

#include "features/image_pyramid.h"
#include "point_line_odometry/types.h"

namespace point_line_odometry {

/// Where features may be in an image of which some pixels are ignored. A masked place is what lies
/// beyond the image's border: features keep the same distance to it, and nothing depends on its
/// pixels. Copies share the levels that one of them adds: a mask that stays is reduced once.
class FeatureMask {
 public:
  /// [px of a level] distance of patches, and of the corners of coarser levels, to masked pixels:
  /// as to the image's border.
  static constexpr int kPatchMargin = 10;
  /// [px] distance of keypoints of the image itself: of their descriptor, sqrt(2) 13 px, and of the
  /// blur before it.
  static constexpr int kPointMargin = 22;
  /// [px] distance of the pixels of edges: of the gradient (5 x 5 Gaussian, 3 x 3 Sobel), and of
  /// its neighbour for the sub-pixel position.
  static constexpr int kEdgeMargin = 4;

  /// Nothing is masked.
  FeatureMask() = default;
  /// \param mask CV_8UC1, 0: ignore; empty: nothing is masked.
  explicit FeatureMask(const cv::Mat& mask);

  /// Whether no pixel is masked; then all other methods allow everything.
  bool empty() const { return visible_.empty(); }

  /// The image with masked pixels of one grey; itself if there are none.
  cv::Mat paint(const cv::Mat& image) const;

  /// Pixels of the image where its keypoints may be, and where edges may be: 255, elsewhere 0;
  /// empty images if nothing is masked.
  const cv::Mat& points() const { return points_; }
  const cv::Mat& edges() const { return edges_; }

  /// Adds the coarser levels of a pyramid of the image.
  void addLevels(const ImagePyramid& image);

  /// The mask of a level as of an image of its own. \param octave of a level that was added.
  const FeatureMask& ofLevel(int octave) const;

  /// The mask of the image at half its size (halve()).
  const FeatureMask& half() const;

  /// Whether a patch, or a corner of a coarser level, may be at a pixel of a level. False outside
  /// of the image.
  bool allowsPatch(const Eigen::Vector2f& level_px, int octave) const;

  /// Whether most of a segment is masked; what lies outside of the image is not counted.
  bool hides(const LineSegment& segment) const;

  /// The longest piece of each segment without masked pixels; segments that have none of at least
  /// `min_length_px` are removed.
  void cut(double min_length_px, std::vector<LineSegment>* segments) const;

  /// Share of the masked pixels.
  double share() const;

 private:
  struct Levels;

  cv::Mat visible_;  // 255, masked pixels 0
  cv::Mat points_;
  cv::Mat edges_;
  std::shared_ptr<Levels> levels_;  // null if nothing is masked
};

/// Of both images of a stereo frame.
struct StereoMasks {
  FeatureMask left;
  FeatureMask right;

  bool empty() const { return left.empty() && right.empty(); }

  /// The images with masked pixels of one grey, without masks.
  StereoImages paint(const StereoImages& images) const {
    return {left.paint(images.left), right.paint(images.right), images.stamp_ns};
  }
};

/// Makes the masks of frame after frame; one that is the same as in the last frame is kept.
class StereoMaskCache {
 public:
  /// The masks of these images.
  const StereoMasks& of(const StereoImages& images);

 private:
  cv::Mat left_;  // copies of the last ones
  cv::Mat right_;
  StereoMasks masks_;
};

/// 255 where a mask is not 0.
cv::Mat binaryMask(const cv::Mat& mask);

}  // namespace point_line_odometry
