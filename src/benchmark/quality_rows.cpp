#include "benchmark/quality_rows.h"

#include <algorithm>
#include <array>
#include <memory>
#include <string>

#include "benchmark/detector_quality.h"
#include "benchmark/row_timer.h"
#include "features/line_feature_detector.h"
#include "point_line_odometry/parameters.h"
#include "point_line_odometry/types.h"
#include "tools/interruption.h"

namespace point_line_odometry {
namespace {

enum Detector { kOurs, kLsd, kNumDetectors };
enum Budget { kAll, kLongest, kNumBudgets };

/// Quality of a detector with a budget, summed over several pairs.
struct Quality {
  std::size_t images = 0;
  std::size_t segments = 0;
  double length_px = 0.0;
  double time_ms = 0.0;  // of all detections, without the measurement
  std::size_t detections = 0;
  Repeatability right;
  Repeatability next;
  EdgeOffsets edges;
};

/// Long segments of one detector in a pair and the frame after it, the longest first.
struct Views {
  std::vector<LineSegment> left;
  std::vector<LineSegment> right;
  std::vector<LineSegment> next;
  std::vector<std::optional<LineSegment>> in_right;  // tracked, one for each in `left`
  std::vector<std::optional<LineSegment>> in_next;
  double time_ms = 0.0;
};

template <typename T>
std::vector<T> firstOf(const std::vector<T>& values, std::size_t n) {
  return {values.begin(), values.begin() + static_cast<std::ptrdiff_t>(n)};
}

/// The n longest of each image, n from the detector that has fewer there.
void keepCommonNumber(std::array<Views, kNumDetectors>* views) {
  const std::size_t left = std::min((*views)[kOurs].left.size(), (*views)[kLsd].left.size());
  const std::size_t right = std::min((*views)[kOurs].right.size(), (*views)[kLsd].right.size());
  const std::size_t next = std::min((*views)[kOurs].next.size(), (*views)[kLsd].next.size());
  for (Views& view : *views) {
    view.left = firstOf(view.left, left);
    view.right = firstOf(view.right, right);
    view.next = firstOf(view.next, next);
    view.in_right = firstOf(view.in_right, left);
    view.in_next = firstOf(view.in_next, left);
  }
}

/// Measures both detectors on the sampled pairs of an input.
class QualityMeasurement {
 public:
  QualityMeasurement(const BenchmarkInput& input, const Parameters& parameters)
      : line_detector_(parameters.lines, LineDetectorKind::kEdgeChains),
        resolution_(lineResolutionAfter(0, parameters.lines)) {
    for (std::size_t i = 0; i < input.numSamples(); ++i) addPair(input.sample(i));
  }

  const Quality& quality(Detector detector, Budget budget) const {
    return qualities_[detector][budget];
  }

 private:
  /// A pair and the frame after it, prepared for the measurement.
  struct Prepared {
    cv::Mat smooth;
    TrackingImage left;
    TrackingImage right;
    TrackingImage next;
    TrackingStart left_to_right;

    explicit Prepared(const BenchmarkInput::Successive& images)
        : smooth(smoothForEdges(images.now.left)),
          left(images.now.left),
          right(images.now.right),
          next(images.next.left),
          left_to_right(startFromDisparity(images.now.left, images.now.right)) {}
  };

  void addPair(const BenchmarkInput::Successive& images) {
    const Prepared prepared(images);
    std::array<Views, kNumDetectors> views;
    for (const Detector detector : {kOurs, kLsd}) {
      if (detector == kLsd && !yardstick_.available()) continue;
      views[detector] = viewsOf(detector, images, prepared);
      addViews(views[detector], prepared.smooth, &qualities_[detector][kAll]);
    }
    if (!yardstick_.available()) return;
    keepCommonNumber(&views);
    for (const Detector detector : {kOurs, kLsd}) {
      addViews(views[detector], prepared.smooth, &qualities_[detector][kLongest]);
    }
  }

  Views viewsOf(Detector detector, const BenchmarkInput::Successive& images,
                const Prepared& prepared) {
    Views views;
    views.left = detect(detector, images.now.left, &views.time_ms);
    views.right = detect(detector, images.now.right, &views.time_ms);
    views.next = detect(detector, images.next.left, &views.time_ms);
    views.in_right =
        trackSegments(prepared.left, prepared.right, views.left, prepared.left_to_right);
    views.in_next = trackSegments(prepared.left, prepared.next, views.left);
    return views;
  }

  std::vector<LineSegment> detect(Detector detector, const cv::Mat& image, double* time_ms) {
    throwIfInterrupted();
    const BenchmarkClock::time_point begin = BenchmarkClock::now();
    std::vector<LineSegment> segments;
    if (detector == kLsd) {
      segments = yardstick_.detect(image);
    } else {
      for (const LineFeature& line : line_detector_.detect(image, resolution_))
        segments.push_back(line.segment);
    }
    *time_ms += elapsedMs(begin);
    return longSegments(std::move(segments), options_);
  }

  void addViews(const Views& views, const cv::Mat& smooth, Quality* quality) const {
    ++quality->images;
    quality->detections += 3;
    quality->time_ms += views.time_ms;
    quality->segments += views.left.size();
    quality->length_px += totalLength_px(views.left);
    quality->right.add(measureRepeatability(views.in_right, views.right, options_));
    quality->next.add(measureRepeatability(views.in_next, views.next, options_));
    quality->edges.add(measureEdgeOffsets(smooth, views.left, options_));
  }

  QualityOptions options_;
  LineFeatureDetector line_detector_;
  LineResolution resolution_;  // full unless all frames are coarse to fine
  Yardstick yardstick_;
  std::array<std::array<Quality, kNumBudgets>, kNumDetectors> qualities_;
};

void report(const Quality& quality, benchmark::State* state) {
  const auto images = static_cast<double>(quality.images);
  state->SetIterationTime(1e-3 * quality.time_ms / static_cast<double>(quality.detections));
  state->counters["segments"] = static_cast<double>(quality.segments) / images;
  state->counters["length_px"] = quality.length_px / images;
  state->counters["right"] = quality.right.share();
  state->counters["right_tracked"] = quality.right.trackedShare();
  state->counters["next"] = quality.next.share();
  state->counters["next_tracked"] = quality.next.trackedShare();
  state->counters["offset_rms"] = quality.edges.rms_px();
  state->counters["offset_med"] = quality.edges.median_px();
  state->counters["on_edge"] = quality.edges.edgeShare();
}

}  // namespace

void registerQualityRows(BenchmarkInput* input, const Parameters& parameters) {
  struct Row {
    const char* name;
    Detector detector;
    Budget budget;
  };
  // Made by the first row that runs, for all of them.
  const auto measurement = std::make_shared<std::unique_ptr<QualityMeasurement>>();
  for (const Row& row :
       {Row{"all_ours", kOurs, kAll}, Row{"all_cv_lsd", kLsd, kAll},
        Row{"n_longest_ours", kOurs, kLongest}, Row{"n_longest_cv_lsd", kLsd, kLongest}}) {
    const auto run = [=, &parameters](benchmark::State& state) {
      if ((row.detector == kLsd || row.budget == kLongest) && !Yardstick().available()) {
        state.SkipWithError(kNoYardstick);
        return;
      }
      for (auto _ : state) {
        state.PauseTiming();
        const SingleThread single_thread;
        if (!*measurement) *measurement = std::make_unique<QualityMeasurement>(*input, parameters);
        state.ResumeTiming();
        report((*measurement)->quality(row.detector, row.budget), &state);
      }
      state.SetLabel(std::to_string(input->numSamples()) + " pairs");
    };
    ::benchmark::RegisterBenchmark((input->name() + "/segments/" + row.name).c_str(), run)
        ->UseManualTime()
        ->Iterations(1)
        ->Unit(::benchmark::kMillisecond);
  }
}

}  // namespace point_line_odometry
