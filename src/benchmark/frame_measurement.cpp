#include "benchmark/frame_measurement.h"

#include <algorithm>
#include <memory>
#include <opencv2/imgproc.hpp>

#include "common/statistics.h"
#include "point_line_odometry/stereo_odometry.h"
#include "tools/interruption.h"

namespace point_line_odometry {
namespace {

constexpr int kPasses = 3;
constexpr std::size_t kBlock = 8;    // frames of one kind in a row
constexpr std::size_t kUntimed = 2;  // frames after the start, which take less time

StereoCamera enlarged(StereoCamera camera, int factor) {
  camera.width *= factor;
  camera.height *= factor;
  camera.fx *= factor;
  camera.fy *= factor;
  const double shift = 0.5 * factor - 0.5;  // pixel 0 has its centre at 0
  camera.cx = factor * camera.cx + shift;
  camera.cy = factor * camera.cy + shift;
  return camera;
}

StereoImages enlarged(const StereoImages& images, int factor) {
  if (factor == 1) return images;
  StereoImages result = images;
  cv::resize(images.left, result.left, {}, factor, factor, cv::INTER_CUBIC);
  cv::resize(images.right, result.right, {}, factor, factor, cv::INTER_CUBIC);
  return result;
}

/// One kind of run over the frames of a sequence.
class TimedRun {
 public:
  TimedRun(const StereoCamera& camera, const std::vector<StereoImages>& frames, const RunKind& kind)
      : frames_(frames), odometry_(enlarged(camera, kind.enlargement), kind.parameters) {
    times_.kind = kind;
  }

  void start() {
    odometry_.reset();
    for (std::size_t i = 0; i < kUntimed; ++i)
      odometry_.process(enlarged(frames_[i], times_.kind.enlargement));
  }

  void run(std::size_t begin, std::size_t end) {
    std::vector<StereoImages> block;
    for (std::size_t i = begin; i < end; ++i)
      block.push_back(enlarged(frames_[i], times_.kind.enlargement));
    const int threads_before = cv::getNumThreads();
    cv::setNumThreads(times_.kind.parameters.tracking.threads);
    for (const StereoImages& images : block) time(images);
    cv::setNumThreads(threads_before);
    odometry_.saveState();  // ends what runs in the background
  }

  const FrameTimes& times() const { return times_; }

 private:
  void time(const StereoImages& images) {
    throwIfInterrupted();
    const Stopwatch stopwatch;
    const FrameResult result = odometry_.process(images);
    times_.frames.add(stopwatch.elapsed());
    for (int i = 0; i < kNumStages; ++i) times_.stages[i].push_back(result.times.ms[i]);
  }

  const std::vector<StereoImages>& frames_;
  StereoOdometry odometry_;
  FrameTimes times_;
};

/// One pass over the frames: a block of each run, and the detector after each block.
void takeTurns(const std::vector<StereoImages>& frames, const std::vector<TimedRun*>& runs,
               CallTimes* yardstick) {
  const Yardstick detector;
  for (TimedRun* run : runs) run->start();
  for (std::size_t begin = kUntimed; begin < frames.size(); begin += kBlock) {
    for (TimedRun* run : runs) {
      run->run(begin, std::min(frames.size(), begin + kBlock));
      if (!detector.available()) continue;
      const SingleThread single_thread;
      const Stopwatch stopwatch;
      detector.detect(frames[begin].left);
      yardstick->add(stopwatch.elapsed());
    }
  }
}

}  // namespace

double FrameTimes::mean_ms() const { return mean(frames.wall_ms); }
double FrameTimes::p95_ms() const { return quantile(frames.wall_ms, 0.95); }
double FrameTimes::cpu_ms() const { return mean(frames.cpu_ms); }
double FrameTimes::stage_ms(Stage stage) const {
  return mean(stages[static_cast<std::size_t>(stage)]);
}

double SequenceTimes::yardstick_ms() const {
  return yardstick.wall_ms.empty() ? 0.0 : median(yardstick.wall_ms);
}

double SequenceTimes::yardstickCpu_ms() const {
  return yardstick.cpu_ms.empty() ? 0.0 : median(yardstick.cpu_ms);
}

SequenceTimes measureFrames(BenchmarkInput* input, const std::vector<RunKind>& kinds) {
  const std::vector<StereoImages>& frames = input->run();
  std::vector<std::unique_ptr<TimedRun>> runs;
  for (const RunKind& kind : kinds)
    runs.push_back(std::make_unique<TimedRun>(input->camera(), frames, kind));
  SequenceTimes result;
  for (int pass = 0; pass < kPasses; ++pass) {
    std::vector<TimedRun*> turns;
    for (const auto& run : runs)
      if (pass == 0 || run->times().kind.enlargement == 1) turns.push_back(run.get());
    takeTurns(frames, turns, &result.yardstick);
  }
  for (const auto& run : runs) result.runs.push_back(run->times());
  return result;
}

}  // namespace point_line_odometry
