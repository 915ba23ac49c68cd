#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "point_line_odometry/rectification.h"
#include "point_line_odometry/stereo_camera.h"
#include "point_line_odometry/types.h"

namespace point_line_odometry {

/// A sequence of rectified stereo frames for measurements. Frames are read or rendered lazily, so
/// that rows that are filtered out cost nothing.
class BenchmarkInput {
 public:
  /// A pair, and the frame after it.
  struct Successive {
    StereoImages now;
    StereoImages next;
  };

  /// A KITTI or EuRoC folder; the input is named after it. \param run_frames largest number of
  /// frames of run(). Throws InputError if it cannot be used or has fewer than kMinFrames.
  static std::unique_ptr<BenchmarkInput> fromFolder(const std::string& folder,
                                                    std::size_t run_frames);

  /// A scene of the synthetic world; the input is named after it.
  static std::unique_ptr<BenchmarkInput> fromWorld(const std::string& scene,
                                                   std::size_t run_frames);

  static constexpr std::size_t kMinFrames = 4;

  const std::string& name() const { return name_; }
  const StereoCamera& camera() const { return camera_; }

  /// Consecutive frames from the start of the sequence, kept in memory. Throws InputError like
  /// StereoDataset::load().
  const std::vector<StereoImages>& run();

  /// The i-th of numSamples() pairs that are sampled evenly from the sequence; not kept in memory.
  Successive sample(std::size_t i) const;

  /// 10, or fewer if the sequence is shorter.
  std::size_t numSamples() const;

 private:
  using Load = std::function<StereoImages(std::size_t)>;

  /// A sequence as stored, raw or rectified.
  struct Sequence {
    std::size_t size = 0;
    StereoCalibration calibration;
    bool needs_rectification = false;
    Load load;
  };

  BenchmarkInput(std::string name, const Sequence& sequence, std::size_t run_frames);

  std::string name_;
  StereoCamera camera_;
  Load load_;  // rectified
  std::size_t size_;
  std::size_t run_frames_;
  std::vector<StereoImages> run_;
};

/// The folders within `folder` that hold a KITTI or EuRoC sequence, by name. Throws InputError if
/// `folder` is not a folder.
std::vector<std::string> findSequences(const std::string& folder);

/// The same, but none if `folder` is a sequence itself or no folder.
std::vector<std::string> sequencesWithin(const std::string& folder);

}  // namespace point_line_odometry
