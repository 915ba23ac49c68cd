#pragma once

#include <cstddef>
#include <memory>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "tools/stereo_source.h"
#include "world/synthetic_world.h"

namespace point_line_odometry {

/// Options of the synthetic world, and the length of the sequence.
struct SyntheticRequest {
  SyntheticWorldOptions world;
  std::string path;
  int frames = 300;
  double length_m = 0.0;
};

/// The length of a sequence; `visit` is called as by visitParameters().
template <typename AnyRequest, typename Visitor>
void visitSyntheticLength(AnyRequest& r, Visitor&& visit) {
  visit("frames", r.frames, 1, 1000000, "", "number of stereo pairs; with `path`: all of it");
  visit("length", r.length_m, 0.0, 1e6, "m",
        "instead of `frames`: distance that the camera travels");
}

/// All options.
template <typename AnyRequest, typename Visitor>
void visitSyntheticRequest(AnyRequest& r, Visitor&& visit) {
  visitWorldOptions(r.world, visit);
  visitSyntheticLength(r, visit);
  visit("path", r.path, "file (TUM) of the left camera's trajectory to follow");
}

/// Stereo pairs of the synthetic world, with their exact ground truth.
class SyntheticSource : public StereoSource {
 public:
  SyntheticSource(SyntheticWorld world, std::size_t num_frames);

  std::size_t size() const override { return num_frames_; }
  const StereoCalibration& calibration() const override { return world_.calibration(); }
  bool needsRectification() const override { return world_.needsRectification(); }
  double frameRate_hz() const { return world_.frameRate_hz(); }

  std::vector<StampedPose> groundTruth() const override;

  std::optional<ImuData> imu() override { return world_.imu(num_frames_ - 1); }
  std::optional<WheelData> wheels() override { return world_.wheels(num_frames_ - 1); }

  std::optional<StereoImages> next() override;

  bool skip() override { return next_ < num_frames_ && ++next_ > 0; }

 private:
  SyntheticWorld world_;
  std::size_t num_frames_;
  std::size_t next_ = 0;
};

/// Collects the options of a request from text.
class SyntheticRequestReader {
 public:
  /// Throws InputError for an unknown name or an invalid value.
  void set(const std::string& name, const std::string& text);

  const SyntheticRequest& request() const { return request_; }

  /// Throws InputError for options that are out of range or contradict each other.
  std::unique_ptr<SyntheticSource> open();

 private:
  std::size_t countFrames(const SyntheticWorld& world) const;

  SyntheticRequest request_;
  std::set<std::string> given_;
};

/// True for names such as "synthetic:street,seed=3".
bool isSyntheticName(const std::string& input);

/// The source of such a name: a scene and options "name=value", separated by commas. Throws
/// InputError for invalid ones.
std::unique_ptr<SyntheticSource> openSynthetic(const std::string& input);

/// Opens a KITTI or EuRoC folder, or the synthetic world, depending on the name.
std::unique_ptr<StereoSource> openDataset(const std::string& input);

}  // namespace point_line_odometry
