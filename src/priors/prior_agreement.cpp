#include "priors/prior_agreement.h"

#include "motion/prior_factor.h"

namespace point_line_odometry {

bool agrees(const MotionPrior& prior, const ImageMotion& images) {
  const PriorFactor factor(prior);
  PriorReport report;
  report.axes = factor.axes();
  report.chi_square = factor.chiSquare(images.T_prev_curr.inverse(), images.covariance);
  return PriorFactor::agrees(report);
}

}  // namespace point_line_odometry
