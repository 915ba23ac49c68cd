#include "tools/recording_replay.h"

#include <algorithm>
#include <stdexcept>
#include <utility>

#include "common/input_error.h"
#include "geometry/se3.h"
#include "point_line_odometry/version.h"

namespace point_line_odometry {

void RecordingComparison::add(const RecordedRun::Frame& recorded, const FrameResult& replayed) {
  const Eigen::Isometry3d difference = recorded.T_odom_camera.inverse() * replayed.T_odom_camera;
  ++frames;
  if (recorded.T_odom_camera.matrix() == replayed.T_odom_camera.matrix() &&
      recorded.state == toString(replayed.state) && recorded.reason == toString(replayed.reason))
    ++equal;
  max_distance_m = std::max(max_distance_m, difference.translation().norm());
  max_angle_rad = std::max(max_angle_rad, rotationAngle(difference.linear()));
}

RecordingReplay::RecordingReplay(RecordedRun run) : run_(std::move(run)) {
  for (std::size_t i = 0; i < run_.frames.size(); ++i) by_stamp_[run_.frames[i].stamp_ns] = i;
}

void RecordingReplay::begin(const std::optional<Parameters>& instead, StereoOdometry* odometry) {
  try {
    odometry->restoreState(run_.state);
  } catch (const std::invalid_argument& error) {
    throw InputError("recording of version " + run_.version + ": " + error.what() +
                     "; replay it with version " + run_.version + ", this is " + version());
  }
  own_parameters_ = instead.has_value();
  if (instead) odometry->setParameters(*instead);
}

void RecordingReplay::prepare(std::int64_t stamp_ns, StereoOdometry* odometry) const {
  const RecordedRun::Frame* frame = find(stamp_ns);
  if (frame != nullptr && frame->parameters && !own_parameters_)
    odometry->setParameters(*frame->parameters);
  if (frame != nullptr && frame->tilt) odometry->correctTilt(*frame->tilt);
}

std::optional<MotionPrior> RecordingReplay::priorOf(std::int64_t stamp_ns) const {
  const RecordedRun::Frame* frame = find(stamp_ns);
  return frame == nullptr ? std::nullopt : frame->prior;
}

void RecordingReplay::compare(const FrameResult& result) {
  const RecordedRun::Frame* frame = find(result.stamp_ns);
  if (frame != nullptr) comparison_.add(*frame, result);
}

const RecordedRun::Frame* RecordingReplay::find(std::int64_t stamp_ns) const {
  const auto found = by_stamp_.find(stamp_ns);
  return found == by_stamp_.end() ? nullptr : &run_.frames[found->second];
}

}  // namespace point_line_odometry
