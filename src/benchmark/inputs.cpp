#include "benchmark/inputs.h"

#include <algorithm>
#include <filesystem>
#include <stdexcept>
#include <utility>

#include "common/input_error.h"
#include "dataset/dataset.h"
#include "tools/interruption.h"
#include "world/synthetic_world.h"

namespace point_line_odometry {
namespace {

namespace fs = std::filesystem;

constexpr std::size_t kWorldFrames = 300;  // from which pairs are sampled
constexpr std::size_t kMaxSamples = 10;    // pairs

std::string nameOf(const std::string& folder) {
  const fs::path path = fs::absolute(folder).lexically_normal();
  return (path.has_filename() ? path : path.parent_path()).filename().string();
}

bool holdsSequence(const fs::path& folder) {
  return fs::is_directory(folder / "image_0") || fs::is_directory(folder / "mav0") ||
         fs::is_directory(folder / "cam0");
}

}  // namespace

BenchmarkInput::BenchmarkInput(std::string name, const Sequence& sequence, std::size_t run_frames)
    : name_(std::move(name)),
      camera_(rectifiedCamera(sequence.calibration)),
      load_(sequence.load),
      size_(sequence.size),
      run_frames_(std::min(run_frames, sequence.size)) {
  if (!sequence.needs_rectification) return;
  const auto rectifier = std::make_shared<StereoRectifier>(sequence.calibration);
  load_ = [rectifier, load = sequence.load](std::size_t i) { return rectifier->rectify(load(i)); };
}

std::unique_ptr<BenchmarkInput> BenchmarkInput::fromFolder(const std::string& folder,
                                                           std::size_t run_frames) {
  const auto dataset = std::make_shared<StereoDataset>(StereoDataset::open(folder));
  if (dataset->size() < kMinFrames) {
    throw InputError("data set '" + folder + "' has only " + std::to_string(dataset->size()) +
                     " frames: give one with " + std::to_string(kMinFrames) + " or more");
  }
  const Sequence sequence{dataset->size(), dataset->calibration(), dataset->needsRectification(),
                          [dataset](std::size_t i) { return dataset->load(i); }};
  try {
    return std::unique_ptr<BenchmarkInput>(
        new BenchmarkInput(nameOf(folder), sequence, run_frames));
  } catch (const std::invalid_argument& error) {
    throw InputError("calibration of '" + folder + "' is unusable: " + error.what());
  }
}

std::unique_ptr<BenchmarkInput> BenchmarkInput::fromWorld(const std::string& scene,
                                                          std::size_t run_frames) {
  SyntheticWorldOptions options;
  options.scene = scene;
  const auto world = std::make_shared<SyntheticWorld>(options);
  const Sequence sequence{kWorldFrames, world->calibration(), world->needsRectification(),
                          [world](std::size_t i) { return world->render(i); }};
  return std::unique_ptr<BenchmarkInput>(new BenchmarkInput(scene, sequence, run_frames));
}

const std::vector<StereoImages>& BenchmarkInput::run() {
  while (run_.size() < run_frames_) {
    throwIfInterrupted();
    run_.push_back(load_(run_.size()));
  }
  return run_;
}

BenchmarkInput::Successive BenchmarkInput::sample(std::size_t i) const {
  throwIfInterrupted();
  const std::size_t first = i * (size_ - 2) / (numSamples() - 1);
  return {load_(first), load_(first + 1)};
}

std::size_t BenchmarkInput::numSamples() const { return std::min(kMaxSamples, size_ - 1); }

std::vector<std::string> sequencesWithin(const std::string& folder) {
  if (!fs::is_directory(folder) || holdsSequence(folder)) return {};
  return findSequences(folder);
}

std::vector<std::string> findSequences(const std::string& folder) {
  std::error_code error;
  std::vector<std::string> found;
  for (const fs::directory_entry& entry : fs::directory_iterator(folder, error)) {
    if (holdsSequence(entry.path())) found.push_back(entry.path().string());
  }
  if (error) {
    throw InputError("data folder '" + folder + "' cannot be read (" + error.message() +
                     "): set POINT_LINE_ODOMETRY_DATA to the folder that holds the sequences");
  }
  std::sort(found.begin(), found.end());
  return found;
}

}  // namespace point_line_odometry
