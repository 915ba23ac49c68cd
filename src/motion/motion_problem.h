#pragma once

#include <Eigen/Geometry>
#include <memory>
#include <vector>

#include "common/thread_pool.h"
#include "motion/correspondence.h"
#include "motion/motion_covariance.h"
#include "motion/prior_factor.h"
#include "point_line_odometry/parameters.h"
#include "point_line_odometry/stereo_camera.h"

namespace point_line_odometry {

/// The least-squares problem of one frame: its matches, their square-root information, and the
/// solver. All motions are T_curr_prev.
class MotionProblem {
 public:
  /// With residuals of the images that motion/residual_images names; all matches are active. All
  /// arguments must outlive it. \param threads null: the thread that calls. \param prior null:
  /// none.
  static std::unique_ptr<MotionProblem> make(const Correspondences& correspondences,
                                             const StereoCamera& camera,
                                             const MotionParameters& parameters,
                                             ThreadPool* threads,
                                             const PriorFactor* prior = nullptr);

  virtual ~MotionProblem() = default;
  MotionProblem(const MotionProblem&) = delete;
  MotionProblem& operator=(const MotionProblem&) = delete;

  const PriorFactor* prior() const { return prior_; }
  const StereoCamera& camera() const { return camera_; }

  // --- Which matches are active

  virtual int numPoints() const = 0;
  virtual int numLines() const = 0;
  /// Matches that constrain the translation: all but far points.
  virtual int numNear() const = 0;
  /// How many of these are expected to be right; see WeightedMatches.
  virtual double expectedRightNear(const Eigen::Isometry3d& T_curr_prev) const = 0;
  virtual const std::vector<bool>& pointActive() const = 0;
  virtual const std::vector<bool>& lineActive() const = 0;

  /// Activates the matches whose whitened residual is within motion/outlier_threshold.
  virtual void selectInliers(const Eigen::Isometry3d& T_curr_prev) = 0;
  /// Activates the matches with reprojection errors below a limit.
  virtual void selectNear(const Eigen::Isometry3d& T_curr_prev, double max_distance_px) = 0;
  /// Activates all matches that have a square-root information.
  virtual void selectAll() = 0;
  /// Activates as pointActive() and lineActive() were before.
  virtual void select(const std::vector<bool>& points, const std::vector<bool>& lines) = 0;
  /// Drops the matches that constrain the translation.
  virtual void dropNear() = 0;
  /// Drops the active matches with a leverage above a limit; see WeightedMatches. Returns their
  /// number.
  virtual int dropLeverage(const Eigen::Isometry3d& T_curr_prev, double limit) = 0;
  /// Drops the active matches of the part of the image that moves the motion most, if there is one;
  /// see SolutionSeparation. Returns their number.
  virtual int dropSeparated(const Eigen::Isometry3d& T_curr_prev) = 0;

  // --- Their information

  /// Square-root information of all residuals at a motion.
  virtual void linearizeInformation(const Eigen::Isometry3d& T_curr_prev) = 0;
  /// The same at an estimate: landmarks of points are refined by both frames. (Of lines no bias was
  /// measurable.)
  virtual void relinearize(const Eigen::Isometry3d& T_curr_prev) = 0;
  /// The translation by which far points are shifted: that of the last linearization.
  virtual const Eigen::Vector3d& translationOfFar() const = 0;

  // --- The estimate

  struct SolveResult {
    bool usable = false;
    Eigen::Isometry3d T_curr_prev = Eigen::Isometry3d::Identity();
    int iterations = 0;
  };

  struct SolveOptions {
    bool fix_rotation = false;
    double function_tolerance;  // relative change of the cost at which the solver stops
  };

  /// Levenberg-Marquardt from an initial motion.
  virtual SolveResult solve(const Eigen::Isometry3d& T_curr_prev,
                            const SolveOptions& options) const = 0;
  /// How well all matches agree with a motion: see WeightedMatches.
  virtual double limitedCost(const Eigen::Isometry3d& T_curr_prev, double limit) const = 0;
  /// The same, where points whose patches overlap count as the one piece of scene that they show:
  /// they are wrong together.
  virtual double limitedCostOfScene(const Eigen::Isometry3d& T_curr_prev, double limit) const = 0;
  /// Sums over the residuals of the active matches, for the covariance.
  virtual ResidualStatistics statistics(const Eigen::Isometry3d& T_curr_prev) const = 0;

 protected:
  MotionProblem(const StereoCamera& camera, const PriorFactor* prior)
      : camera_(camera), prior_(prior) {}

 private:
  const StereoCamera& camera_;
  const PriorFactor* prior_;
};

}  // namespace point_line_odometry
