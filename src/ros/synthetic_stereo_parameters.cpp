#include "ros/synthetic_stereo_parameters.h"

#include <optional>
#include <set>
#include <vector>

#include "common/join.h"
#include "common/parameter_checker.h"
#include "ros/parameter_tree.h"
#include "ros/played_camera.h"

namespace point_line_odometry {
namespace {

/// Texts may be empty here.
struct Checker : ParameterChecker {
  using ParameterChecker::operator();
  void operator()(const char*, const std::string&, const char*) {}
};

void checkFrameNames(const SyntheticStereoParameters& p, std::vector<std::string>* errors) {
  const std::set<std::string> names = {p.odom_frame_id, p.base_frame_id, p.left_frame_id,
                                       p.right_frame_id};
  if (names.size() == 4 && names.count("") == 0) return;
  errors->push_back(
      "odom_frame_id, base_frame_id, left_frame_id and right_frame_id must be four different "
      "names");
}

void checkTogether(const SyntheticStereoParameters& p, std::vector<std::string>* errors) {
  if (p.exit_when_done && p.frames == 0 && p.length_m == 0.0) {
    errors->push_back("exit_when_done needs frames or length, after which to end");
  }
  if (p.frames != 0 && p.length_m != 0.0)
    errors->push_back("frames and length are both given, but only one of them can be");
  if (p.rate != 1.0 && !p.publish_clock) {
    errors->push_back("rate needs publish_clock: real time cannot be made faster or slower");
  }
  if (!p.lockstep_topic.empty() && !p.publish_clock) {
    errors->push_back("lockstep_topic needs publish_clock: real time does not wait");
  }
}

/// Camera, frames and rate of the driver that is played. A sentence if there is none of that name.
std::string applyPlayedCamera(SyntheticStereoParameters* p) {
  if (p->as.empty()) return {};
  const std::optional<PlayedCamera> played = playedCamera(p->as);
  if (!played)
    return "as is '" + p->as + "', but must be one of " + join(playedCameraNames(), ", ");
  p->base_frame_id = played->base_frame;
  p->left_frame_id = played->sides[0].frame;
  p->right_frame_id = played->sides[1].frame;
  p->world.camera = played->calibration;
  p->world.camera_is_raw = played->raw;
  if (p->world.frame_rate_hz == 0.0) p->world.frame_rate_hz = played->frame_rate_hz;
  return {};
}

}  // namespace

SyntheticStereoParameters parseSyntheticStereoParameters(const XmlRpc::XmlRpcValue& tree) {
  SyntheticStereoParameters parameters;
  ParameterTree values(tree);
  visitWorldOptions(parameters.world, values);
  visitSyntheticStereoParameters(parameters, values);
  std::vector<std::string> errors = values.errors();
  try {
    if (!parameters.path.empty()) parameters.world.path = readTum(parameters.path);
  } catch (const InputError& error) {
    errors.emplace_back(error.what());
  }
  if (const std::string unknown = applyPlayedCamera(&parameters); !unknown.empty())
    errors.push_back(unknown);
  Checker checker;
  visitSyntheticStereoParameters(parameters, checker);
  checkFrameNames(parameters, &checker.errors);
  checkTogether(parameters, &checker.errors);
  for (const auto& more : {checker.errors, checkWorldOptions(parameters.world)}) {
    errors.insert(errors.end(), more.begin(), more.end());
  }
  requireNoParameterErrors(errors);
  return parameters;
}

}  // namespace point_line_odometry
