#include "benchmark/frame_row.h"

#include <array>
#include <string>
#include <vector>

#include "benchmark/row_timer.h"
#include "common/statistics.h"
#include "point_line_odometry/frame_result.h"
#include "point_line_odometry/parameters.h"
#include "point_line_odometry/stereo_odometry.h"
#include "point_line_odometry/types.h"

namespace point_line_odometry {
namespace {

constexpr double kPace = 2.0;  // time between two calls of the yardstick, in times of one call
constexpr int kIterations = 100;
constexpr std::size_t kUntimedAfterReset = 2;  // frames after a reset, which take less time

using StageSamples = std::array<std::vector<double>, kNumStages>;

void reportStages(const StageSamples& samples, benchmark::State* state) {
  for (int i = 0; i < kNumStages; ++i) {
    state->counters[toString(static_cast<Stage>(i))] = mean(samples[i]);
  }
}

void runFrames(benchmark::State& state, BenchmarkInput* input, const Parameters& parameters) {
  const std::vector<StereoImages>& run = input->run();
  StereoOdometry odometry(input->camera(), parameters);
  RowTimer timer(&state, kPace);
  StageSamples stages;
  std::vector<double> inliers;
  std::size_t ok = 0;
  std::size_t next = 0;
  FrameResult result;
  for (auto _ : state) {
    if (next == 0) {
      state.PauseTiming();
      odometry.reset();
      while (next < kUntimedAfterReset) odometry.process(run[next++]);
      state.ResumeTiming();
    }
    const StereoImages& images = run[next];
    timer.time(images.left, [&] { result = odometry.process(images); });
    for (int i = 0; i < kNumStages; ++i) stages[i].push_back(result.times.ms[i]);
    inliers.push_back(result.counts.point_inliers + result.counts.line_inliers);
    ok += result.state == TrackingState::kOk ? 1 : 0;
    next = (next + 1) % run.size();
  }
  timer.report(static_cast<std::size_t>(median(inliers)));
  state.counters["ok"] = static_cast<double>(ok) / static_cast<double>(inliers.size());
  reportStages(stages, &state);
  state.SetLabel(std::to_string(run.size()) + " frames, " +
                 std::to_string(parameters.tracking.threads) + " threads");
}

}  // namespace

void registerFrameRow(BenchmarkInput* input, const Parameters& parameters) {
  ::benchmark::RegisterBenchmark(
      (input->name() + "/frame").c_str(),
      [input, &parameters](benchmark::State& state) { runFrames(state, input, parameters); })
      ->UseManualTime()
      ->MeasureProcessCPUTime()
      ->Iterations(kIterations)
      ->Unit(::benchmark::kMillisecond);
}

}  // namespace point_line_odometry
