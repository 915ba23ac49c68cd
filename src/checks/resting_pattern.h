#pragma once

#include <vector>

#include "checks/followed_frame.h"

namespace point_line_odometry {

/// Points that rest in the images among others of the same depth that move: the pattern of a
/// projector at the camera.
struct RestingPattern {
  int compared = 0;  ///< points among others that move
  int resting = 0;   ///< those of them that rest
  int cells = 0;     ///< of 4 x 3 parts of the image, those with several of them

  /// True if there are more of them, in more parts, than without a projector.
  bool isThere() const;
};

/// Compares each point with those near it in the image and in depth that move alike: with none of
/// these, nothing can be said of it.
RestingPattern findRestingPattern(const std::vector<const FollowedFrame*>& frames);

}  // namespace point_line_odometry
