#include "benchmark/stage_rows.h"

#include <memory>
#include <opencv2/features2d.hpp>
#include <string>
#include <vector>

#include "benchmark/row_timer.h"
#include "benchmark/stages.h"

namespace point_line_odometry {
namespace {

constexpr double kPace = 1.0;  // as much time for the yardstick as for the row

struct StageRow {
  const char* name;
  std::size_t (Stages::*call)();
};

constexpr StageRow kStageRows[] = {{"lines", &Stages::lines},
                                   {"points", &Stages::points},
                                   {"match_stereo", &Stages::matchStereo},
                                   {"triangulate", &Stages::triangulate},
                                   {"match_circular", &Stages::matchCircular},
                                   {"correspondences", &Stages::correspondences},
                                   {"estimate", &Stages::estimate},
                                   {"fuse", &Stages::fuse}};

/// Registers a row of calls that return the number of their results.
template <typename Run>
void registerRow(const BenchmarkInput& input, const char* name, const Run& run) {
  ::benchmark::RegisterBenchmark((input.name() + "/" + name).c_str(), run)
      ->UseManualTime()
      ->Unit(::benchmark::kMillisecond);
}

template <typename Call>
void timeCalls(benchmark::State& state, const cv::Mat& image, const Call& call) {
  RowTimer timer(&state, kPace);
  std::size_t found = 0;
  for (auto _ : state) timer.time(image, [&] { found = call(); });
  timer.report(found);
}

void runLsd(benchmark::State& state, const cv::Mat& image) {
  const Yardstick yardstick;
  if (!yardstick.available()) {
    state.SkipWithError(kNoYardstick);
    return;
  }
  const SingleThread single_thread;
  timeCalls(state, image, [&] { return yardstick.detect(image).size(); });
  state.SetLabel(openCvVersion());
}

/// OpenCV's ORB, with as many points as our detector has found.
void runOrb(benchmark::State& state, const cv::Mat& image, const Parameters& parameters) {
  const SingleThread single_thread;
  const std::size_t ours = PointDetector(parameters.points).detect(image).size();
  const cv::Ptr<cv::ORB> orb = cv::ORB::create(static_cast<int>(ours));
  std::vector<cv::KeyPoint> keypoints;
  cv::Mat descriptors;
  timeCalls(state, image, [&] {
    orb->detectAndCompute(image, cv::noArray(), keypoints, descriptors);
    return keypoints.size();
  });
  state.SetLabel(openCvVersion());
}

std::string sizeOf(const cv::Mat& image) {
  return std::to_string(image.cols) + " x " + std::to_string(image.rows) + " px";
}

const cv::Mat& middleImage(BenchmarkInput* input) {
  return input->run()[input->run().size() / 2].left;
}

}  // namespace

void registerStageRows(BenchmarkInput* input, const Parameters& parameters) {
  // Made by the first row that runs, for all of them.
  const auto made = std::make_shared<std::unique_ptr<Stages>>();
  const auto stages = [made, input, &parameters]() -> Stages& {
    if (!*made) *made = std::make_unique<Stages>(input, parameters);
    return **made;
  };
  registerRow(*input, "cv_lsd",
              [input](benchmark::State& state) { runLsd(state, middleImage(input)); });
  registerRow(*input, "cv_orb", [input, &parameters](benchmark::State& state) {
    runOrb(state, middleImage(input), parameters);
  });
  for (const StageRow& row : kStageRows) {
    registerRow(*input, row.name, [stages, row](benchmark::State& state) {
      const SingleThread single_thread;
      timeCalls(state, stages().image(), [&] { return (stages().*row.call)(); });
      state.SetLabel(sizeOf(stages().image()));
    });
  }
  registerRow(*input, "features_stereo", [stages, &parameters](benchmark::State& state) {
    timeCalls(state, stages().image(), [&] { return stages().detectStereo(); });
    state.SetLabel(sizeOf(stages().image()) + ", " + std::to_string(parameters.tracking.threads) +
                   " threads");
  });
}

}  // namespace point_line_odometry
