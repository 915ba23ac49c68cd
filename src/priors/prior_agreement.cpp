#include "priors/prior_agreement.h"

#include "motion/prior_factor.h"

namespace point_line_odometry {

bool agrees(const MotionPrior& prior, const ImageMotion& images) {
  return PriorFactor::agrees(PriorFactor::compare(prior, images.T_prev_curr, images.covariance));
}

}  // namespace point_line_odometry
