#include "ros/synthetic_stereo_parameters.h"

#include <set>
#include <vector>

#include "odometry/parameter_checker.h"
#include "ros/parameter_tree.h"

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
  if (p.exit_when_done && p.frames == 0) {
    errors->push_back("exit_when_done needs frames, the number of frames after which to end");
  }
  if (p.rate != 1.0 && !p.publish_clock) {
    errors->push_back("rate needs publish_clock: real time cannot be made faster or slower");
  }
  if (!p.lockstep_topic.empty() && !p.publish_clock) {
    errors->push_back("lockstep_topic needs publish_clock: real time does not wait");
  }
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
