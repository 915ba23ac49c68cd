#include "tools/synthetic_source.h"

#include <sstream>
#include <stdexcept>
#include <utility>

#include "common/input_error.h"
#include "common/join.h"
#include "common/parameter_checker.h"
#include "dataset/trajectory.h"
#include "tools/parameter_text.h"

namespace point_line_odometry {
namespace {

constexpr const char* kSyntheticPrefix = "synthetic:";

}  // namespace

SyntheticSource::SyntheticSource(SyntheticWorld world, std::size_t num_frames)
    : world_(std::move(world)), num_frames_(num_frames) {}

std::vector<StampedPose> SyntheticSource::groundTruth() const {
  std::vector<StampedPose> poses;
  for (std::size_t i = 0; i < num_frames_; ++i) poses.push_back(world_.pose(i));
  return poses;
}

std::optional<StereoImages> SyntheticSource::next() {
  if (next_ >= num_frames_) return std::nullopt;
  return world_.render(next_++);
}

void SyntheticRequestReader::set(const std::string& name, const std::string& text) {
  ParameterSetter setter{name, text, false};
  visitSyntheticRequest(request_, setter);
  if (!setter.found) {
    throw InputError("the synthetic world has no option '" + name +
                     "': 'synthetic_world --help' shows those there are");
  }
  given_.insert(name);
}

std::unique_ptr<SyntheticSource> SyntheticRequestReader::open() {
  if (given_.count("frames") > 0 && given_.count("length") > 0) {
    throw InputError("the synthetic world is given both frames and length: give one of them");
  }
  ParameterChecker checker;
  visitSyntheticLength(request_, checker);
  std::vector<std::string> errors = checkWorldOptions(request_.world);
  errors.insert(errors.end(), checker.errors.begin(), checker.errors.end());
  if (!errors.empty()) throw InputError("the synthetic world's " + join(errors, "; "));
  if (!request_.path.empty()) request_.world.path = readTum(request_.path);
  try {
    SyntheticWorld world(request_.world);
    const std::size_t num_frames = countFrames(world);
    return std::make_unique<SyntheticSource>(std::move(world), num_frames);
  } catch (const std::invalid_argument& error) {
    throw InputError(std::string("the synthetic world cannot be made: ") + error.what());
  }
}

std::size_t SyntheticRequestReader::countFrames(const SyntheticWorld& world) const {
  if (given_.count("length") > 0) return world.framesForLength(request_.length_m);
  const std::vector<StampedPose>& path = request_.world.path;
  if (path.empty() || given_.count("frames") > 0) {
    return static_cast<std::size_t>(request_.frames);
  }
  const double duration_s = static_cast<double>(path.back().stamp_ns - path[0].stamp_ns) * 1e-9;
  constexpr double kRounding = 1e-6;
  return 1 + static_cast<std::size_t>(duration_s * world.frameRate_hz() + kRounding);
}

bool isSyntheticName(const std::string& input) { return input.rfind(kSyntheticPrefix, 0) == 0; }

std::unique_ptr<SyntheticSource> openSynthetic(const std::string& input) {
  SyntheticRequestReader reader;
  std::istringstream parts(input.substr(std::string(kSyntheticPrefix).size()));
  bool first = true;
  for (std::string part; std::getline(parts, part, ','); first = false) {
    const std::size_t equals = part.find('=');
    if (equals != std::string::npos) {
      reader.set(part.substr(0, equals), part.substr(equals + 1));
    } else if (first) {
      reader.set("scene", part);
    } else {
      throw InputError("'" + part + "' in '" + input + "' has no '=': write name=value");
    }
  }
  return reader.open();
}

std::unique_ptr<StereoSource> openDataset(const std::string& input) {
  if (isSyntheticName(input)) return openSynthetic(input);
  return openFolder(input);
}

}  // namespace point_line_odometry
