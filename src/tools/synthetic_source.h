#pragma once

#include <algorithm>
#include <cmath>
#include <memory>
#include <set>
#include <sstream>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "common/join.h"
#include "odometry/parameter_checker.h"
#include "point_line_odometry/synthetic_world.h"
#include "tools/parameter_text.h"
#include "tools/stereo_source.h"

namespace point_line_odometry {

/// What is asked of the synthetic world, and for how long.
struct SyntheticRequest {
  SyntheticWorldOptions world;
  std::string path;
  int frames = 300;
  double length_m = 0.0;
};

/// How long a sequence is; `visit` is called as by visitParameters().
template <typename AnyRequest, typename Visitor>
void visitSyntheticLength(AnyRequest& r, Visitor&& visit) {
  visit("frames", r.frames, 1, 1000000, "", "number of stereo pairs; with `path`: all of it");
  visit("length", r.length_m, 0.0, 1e6, "m",
        "instead of `frames`: until the camera has gone so far");
}

/// All that can be asked for.
template <typename AnyRequest, typename Visitor>
void visitSyntheticRequest(AnyRequest& r, Visitor&& visit) {
  visitWorldOptions(r.world, visit);
  visitSyntheticLength(r, visit);
  visit("path", r.path, "file (TUM) of the left camera's trajectory to follow");
}

/// Stereo pairs of the synthetic world, with their exact ground truth.
class SyntheticSource : public StereoSource {
 public:
  SyntheticSource(SyntheticWorld world, std::size_t num_frames)
      : world_(std::move(world)), num_frames_(num_frames) {}

  std::size_t size() const override { return num_frames_; }
  const StereoCalibration& calibration() const override { return world_.calibration(); }
  bool needsRectification() const override { return world_.needsRectification(); }
  double frameRate_hz() const { return world_.frameRate_hz(); }

  std::vector<StampedPose> groundTruth() const override {
    std::vector<StampedPose> poses;
    for (std::size_t i = 0; i < num_frames_; ++i) poses.push_back(world_.pose(i));
    return poses;
  }

  std::optional<StereoImages> next() override {
    if (next_ >= num_frames_) return std::nullopt;
    return world_.render(next_++);
  }

  bool skip() override { return next_ < num_frames_ && ++next_ > 0; }

 private:
  SyntheticWorld world_;
  std::size_t num_frames_;
  std::size_t next_ = 0;
};

/// Gathers what is asked for, text by text.
class SyntheticRequestReader {
 public:
  /// Throws InputError for an unknown name or a text that does not fit.
  void set(const std::string& name, const std::string& text) {
    ParameterSetter setter{name, text, false};
    visitSyntheticRequest(request_, setter);
    if (!setter.found) {
      throw InputError("the synthetic world has no option '" + name +
                       "': 'synthetic_world --help' shows those there are");
    }
    given_.insert(name);
  }

  const SyntheticRequest& request() const { return request_; }

  /// Throws InputError for what is out of range or contradicts itself.
  std::unique_ptr<SyntheticSource> open() {
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

 private:
  std::size_t countFrames(const SyntheticWorld& world) const {
    if (given_.count("length") > 0) return world.framesForLength(request_.length_m);
    const std::vector<StampedPose>& path = request_.world.path;
    if (path.empty() || given_.count("frames") > 0) {
      return static_cast<std::size_t>(request_.frames);
    }
    const double duration_s = static_cast<double>(path.back().stamp_ns - path[0].stamp_ns) * 1e-9;
    constexpr double kRounding = 1e-6;
    return 1 + static_cast<std::size_t>(duration_s * world.frameRate_hz() + kRounding);
  }

  SyntheticRequest request_;
  std::set<std::string> given_;
};

constexpr const char* kSyntheticPrefix = "synthetic:";

/// True for "synthetic:street,seed=3", which names no file but the synthetic world.
inline bool isSyntheticName(const std::string& input) {
  return input.rfind(kSyntheticPrefix, 0) == 0;
}

/// The source that such a name means: a scene, and options "name=value", with commas between them.
/// Throws InputError for what does not fit.
inline std::unique_ptr<SyntheticSource> openSynthetic(const std::string& input) {
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

/// A KITTI or EuRoC folder or the synthetic world, whatever the name means.
inline std::unique_ptr<StereoSource> openDataset(const std::string& input) {
  if (isSyntheticName(input)) return openSynthetic(input);
  return std::make_unique<FolderSource>(StereoDataset::open(input));
}

}  // namespace point_line_odometry
