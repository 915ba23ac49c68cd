#include "benchmark/summary.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <iomanip>
#include <iostream>
#include <iterator>
#include <memory>
#include <opencv2/core/types.hpp>
#include <optional>
#include <sstream>
#include <thread>
#include <utility>

#include "benchmark/frame_measurement.h"
#include "benchmark/inputs.h"
#include "benchmark/memory_probe.h"
#include "common/classic_stream.h"
#include "tools/interruption.h"
#include "world/synthetic_world.h"

namespace point_line_odometry {
namespace {

constexpr double kSameSize = 0.1;      // relative difference of width and height
constexpr int kEnlargement = 3;        // of the large images
constexpr double kNoLimit_Mpx = 1000;  // of tracking/max_megapixels

/// A camera that the summary always has, and what is known for it.
struct ReferenceCamera {
  const char* name;
  cv::Size size;
  const char* scene;  // of the synthetic world, where no sequence is given
};
constexpr int kKitti = 0;
constexpr int kEuroc = 1;
const ReferenceCamera kCameras[] = {{"KITTI", {1242, 375}, "street"},
                                    {"EuRoC", {752, 480}, "indoor"}};

/// Another system: its time for a frame over that of OpenCV's detector for an image, on two cores.
struct Peer {
  const char* name;
  std::array<const char*, 2> of_lsd;  // KITTI, EuRoC
};
constexpr Peer kPeers[] = {{"PL-StVO, points and lines", {"2.6", "2.3"}},
                           {"PL-StVO, points alone", {"0.28", "0.30"}},
                           {"ORB-SLAM2, points", {"1.4", "0.70"}},
                           {"viso2, points", {"0.51", "0.51"}}};

/// A column of the tables.
struct Column {
  std::unique_ptr<BenchmarkInput> input;
  std::optional<int> camera;  // index in kCameras
  SequenceTimes times;
  double peak_MB = 0.0;

  std::string heading() const {
    return input->name() + ", " + std::to_string(input->camera().width) + " x " +
           std::to_string(input->camera().height);
  }
  const FrameTimes& run(const std::string& name) const {
    return *std::find_if(times.runs.begin(), times.runs.end(),
                         [&](const FrameTimes& run) { return run.kind.name == name; });
  }
  bool has(const std::string& name) const {
    return std::any_of(times.runs.begin(), times.runs.end(),
                       [&](const FrameTimes& run) { return run.kind.name == name; });
  }
};
using Columns = std::vector<Column>;

const char* const kOneThread = "one thread";
const char* const kTwoThreads = "two threads";
const char* const kLarge = "large";
const char* const kLargeWhole = "large, not reduced";

int numCores() { return std::max(1, static_cast<int>(std::thread::hardware_concurrency())); }

/// The kind with the most threads.
std::string mostThreads() {
  return numCores() > 2 ? std::to_string(numCores()) + " threads" : kTwoThreads;
}

bool sameSize(const cv::Size& a, const cv::Size& b) {
  const auto near = [](int x, int y) { return std::abs(x - y) <= kSameSize * std::max(x, y); };
  return near(a.width, b.width) && near(a.height, b.height);
}

int difference(const cv::Size& a, const cv::Size& b) {
  return std::abs(a.width - b.width) + std::abs(a.height - b.height);
}

cv::Size sizeOf(const BenchmarkInput& input) {
  return {input.camera().width, input.camera().height};
}

/// One input for each size of images: KITTI's, EuRoC's, and others that are given.
Columns chooseInputs(const SummaryOptions& options) {
  std::vector<std::unique_ptr<BenchmarkInput>> given;
  for (const std::string& folder : options.sequences)
    given.push_back(BenchmarkInput::fromFolder(folder, options.frames));
  const auto take = [&given](const cv::Size& size) -> std::unique_ptr<BenchmarkInput> {
    std::unique_ptr<BenchmarkInput>* nearest = nullptr;
    for (std::unique_ptr<BenchmarkInput>& input : given) {
      if (!input || !sameSize(sizeOf(*input), size)) continue;
      if (nearest == nullptr ||
          difference(sizeOf(*input), size) < difference(sizeOf(**nearest), size)) {
        nearest = &input;
      }
    }
    return nearest == nullptr ? nullptr : std::move(*nearest);
  };
  Columns columns;
  for (int i : {kKitti, kEuroc}) {
    const ReferenceCamera& camera = kCameras[i];
    std::unique_ptr<BenchmarkInput> input = take(camera.size);
    if (!input) {
      std::cerr << "benchmark: no sequence of about " << camera.size.width << " x "
                << camera.size.height << " px is given: the built-in world's '" << camera.scene
                << "' serves for " << camera.name << "'s\n";
      input = BenchmarkInput::fromWorld(camera.scene, options.frames);
    }
    columns.push_back({std::move(input), i, {}, 0.0});
  }
  for (std::unique_ptr<BenchmarkInput>& input : given) {
    const bool is_new = input && std::none_of(columns.begin(), columns.end(), [&](const Column& c) {
                          return sameSize(sizeOf(*c.input), sizeOf(*input));
                        });
    if (is_new) columns.push_back({std::move(input), std::nullopt, {}, 0.0});
  }
  return columns;
}

RunKind kindOf(const std::string& name, Parameters parameters, int threads, int enlargement = 1) {
  parameters.tracking.threads = threads;
  return {name, parameters, enlargement};
}

std::vector<RunKind> kindsFor(const Column& column, const Parameters& parameters) {
  std::vector<RunKind> kinds{kindOf(kTwoThreads, parameters, 2), kindOf(kOneThread, parameters, 1)};
  if (numCores() > 2) kinds.push_back(kindOf(mostThreads(), parameters, numCores()));
  if (column.camera != kKitti) return kinds;
  kinds.push_back(kindOf(kLarge, parameters, 2, kEnlargement));
  Parameters whole = parameters;
  whole.tracking.max_megapixels = kNoLimit_Mpx;
  kinds.push_back(kindOf(kLargeWhole, whole, 2, kEnlargement));
  return kinds;
}

/// A table in Markdown, row by row.
class Table {
 public:
  explicit Table(const std::vector<std::string>& headings) {
    row(headings);
    row(std::vector<std::string>(headings.size(), "---"));
  }
  void row(const std::vector<std::string>& cells) {
    text_ += "|";
    for (const std::string& cell : cells) text_ += (cell == "---" ? cell : " " + cell + " ") + "|";
    text_ += "\n";
  }
  const std::string& text() const { return text_; }

 private:
  std::string text_;
};

std::string number(double value, int decimals) {
  std::ostringstream text = classicStream();
  text << std::fixed << std::setprecision(decimals) << value;
  return text.str();
}

std::string ratio(double value, double over) { return over > 0.0 ? number(value / over, 2) : ""; }

/// Cells of a row that has one for each column, made by `cell`, and the goal last.
template <typename Cell>
std::vector<std::string> cellsOf(const std::string& name, const Columns& columns, const Cell& cell,
                                 const std::string& goal) {
  std::vector<std::string> cells{name};
  for (const Column& column : columns) cells.push_back(cell(column));
  cells.push_back(goal);
  return cells;
}

/// The same with two cells for each column: `time_ms` of it and its ratio to `unit_ms`.
template <typename Time, typename Unit>
std::vector<std::string> timeCells(const std::string& name, const Columns& columns,
                                   const Time& time_ms, const Unit& unit_ms,
                                   const std::string& goal) {
  std::vector<std::string> cells{name};
  for (const Column& column : columns) {
    cells.push_back(number(time_ms(column), 1));
    cells.push_back(ratio(time_ms(column), unit_ms(column)));
  }
  cells.push_back(goal);
  return cells;
}

std::string timeTable(const Columns& columns) {
  std::vector<std::string> headings{"whole stereo frame"};
  for (const Column& column : columns) {
    headings.push_back(column.heading() + ": ms");
    headings.emplace_back("of cv LSD");
  }
  headings.emplace_back("goal");
  Table table(headings);
  const auto lsd_ms = [](const Column& c) { return c.times.yardstick_ms(); };
  const auto lsd_cpu_ms = [](const Column& c) { return c.times.yardstickCpu_ms(); };
  const auto row = [&](const std::string& name, const std::string& run, const char* goal) {
    const auto frame_ms = [&](const Column& c) { return c.run(run).mean_ms(); };
    table.row(timeCells(name, columns, frame_ms, lsd_ms, goal));
  };
  row(kTwoThreads, kTwoThreads, "<= 0.25");
  row(kOneThread, kOneThread, "<= 0.45");
  if (mostThreads() != kTwoThreads) row(mostThreads(), mostThreads(), "");
  for (const char* run : {kTwoThreads, kOneThread}) {
    const auto cpu_ms = [&](const Column& c) { return c.run(run).cpu_ms(); };
    table.row(timeCells(std::string("processor time, ") + run, columns, cpu_ms, lsd_cpu_ms, ""));
  }
  table.row(timeCells("cv LSD, one image", columns, lsd_ms, lsd_ms, ""));
  table.row(timeCells("processor time, cv LSD", columns, lsd_cpu_ms, lsd_cpu_ms, ""));
  for (const Peer& peer : kPeers) {
    std::vector<std::string> cells{peer.name};
    for (const Column& column : columns) {
      cells.emplace_back();
      cells.emplace_back(column.camera ? peer.of_lsd[static_cast<std::size_t>(*column.camera)]
                                       : "");
    }
    cells.emplace_back();
    table.row(cells);
  }
  return table.text();
}

/// How many times as long a run takes as that on two threads, "" without it.
std::string timesAsLong(const Column& column, const std::string& run) {
  if (!column.has(run)) return "";
  return ratio(column.run(run).mean_ms(), column.run(kTwoThreads).mean_ms());
}

std::string spreadOf(const Column& column, const std::string& run) {
  return ratio(column.run(run).p95_ms(), column.run(run).mean_ms());
}

std::string otherTable(const Columns& columns) {
  std::vector<std::string> headings{""};
  for (const Column& column : columns) headings.push_back(column.heading());
  headings.emplace_back("goal");
  Table table(headings);
  const auto row = [&](const std::string& name, const auto& cell, const char* goal) {
    table.row(cellsOf(name, columns, cell, goal));
  };
  row(
      "95 % of the frames below, two threads [means]",
      [](const Column& c) { return spreadOf(c, kTwoThreads); }, "<= 1.5");
  row(
      "95 % of the frames below, one thread [means]",
      [](const Column& c) { return spreadOf(c, kOneThread); }, "<= 1.5");
  row(
      "images 3 times as wide and high: time [times]",
      [](const Column& c) { return timesAsLong(c, kLarge); }, "<= 3");
  row(
      "the same in full (`tracking/max_megapixels: 1000`) [times]",
      [](const Column& c) { return timesAsLong(c, kLargeWhole); }, "");
  row(
      "memory, peak [MB]", [](const Column& c) { return number(c.peak_MB, 0); }, "<= 120");
  return table.text();
}

double sumOfStages_ms(const FrameTimes& run) {
  double sum_ms = 0.0;
  for (int i = 0; i < kNumStages; ++i) sum_ms += run.stage_ms(static_cast<Stage>(i));
  return sum_ms;
}

std::string stageTable(const Columns& columns) {
  const std::string most = mostThreads();
  std::vector<std::string> headings{"stage, mean [ms]"};
  for (const Column& column : columns) {
    headings.push_back(column.input->name() + ": " + kOneThread);
    headings.push_back(most);
    headings.emplace_back("ratio");
  }
  Table table(headings);
  const auto row = [&](const std::string& name, const auto& time_ms) {
    std::vector<std::string> cells{name};
    for (const Column& column : columns) {
      const double one = time_ms(column.run(kOneThread));
      const double many = time_ms(column.run(most));
      cells.insert(cells.end(), {number(one, 2), number(many, 2), ratio(many, one)});
    }
    table.row(cells);
  };
  for (int i = 0; i < kNumStages; ++i) {
    const auto stage = static_cast<Stage>(i);
    const bool runs = std::any_of(columns.begin(), columns.end(), [&](const Column& c) {
      return c.run(kOneThread).stage_ms(stage) > 0.0;
    });
    if (runs) row(toString(stage), [&](const FrameTimes& run) { return run.stage_ms(stage); });
  }
  row("between the stages",
      [](const FrameTimes& run) { return run.mean_ms() - sumOfStages_ms(run); });
  row("whole frame", [](const FrameTimes& run) { return run.mean_ms(); });
  return table.text();
}

/// The stages that threads do not speed up, of those that matter.
std::string notScaling(const Columns& columns) {
  constexpr double kMatters = 0.02;  // of the frame
  constexpr double kScales = 0.8;    // of the time on one thread
  std::string names;
  for (int i = 0; i < kNumStages; ++i) {
    const auto stage = static_cast<Stage>(i);
    const bool stays = std::any_of(columns.begin(), columns.end(), [&](const Column& c) {
      const double many = c.run(mostThreads()).stage_ms(stage);
      return many > kMatters * c.run(mostThreads()).mean_ms() &&
             many > kScales * c.run(kOneThread).stage_ms(stage);
    });
    if (stays) names += std::string(names.empty() ? "" : ", ") + toString(stage);
  }
  return "Stages that more threads do not speed up by a fifth: " +
         (names.empty() ? "none" : names) + ".\n";
}

double peakMemory_MB(MemoryProbe* probe, BenchmarkInput* input) {
  MemoryUse use;
  for (const StereoImages& images : input->run()) {
    throwIfInterrupted();
    use = probe->process(input->camera(), images);
  }
  return use.peak_MB;
}

/// Memory along a drive through the built-in street.
std::string driveTable(MemoryProbe* probe, double length_m) {
  constexpr std::size_t kRows = 8;
  SyntheticWorldOptions options;
  options.scene = "street";
  const SyntheticWorld world(options);
  const StereoCamera camera = rectifiedCamera(world.calibration());
  const std::size_t num_frames = world.framesForLength(length_m);
  Table table({"driven [m]", "memory [MB]", "peak [MB]", "goal"});
  std::size_t done = 0;
  MemoryUse use;  // of a drive of few frames some rows have no new one
  for (std::size_t row = 1; row <= kRows; ++row) {
    for (; done < num_frames * row / kRows; ++done) {
      throwIfInterrupted();
      use = probe->process(camera, world.render(done));
    }
    const double driven_m = length_m * static_cast<double>(row) / kRows;
    table.row({number(driven_m, 0), number(use.resident_MB, 1), number(use.peak_MB, 1),
               row == kRows ? "<= 120, as at the half" : ""});
  }
  return table.text();
}

}  // namespace

std::string summarize(const SummaryOptions& options) {
  Parameters two_threads = options.parameters;
  two_threads.tracking.threads = 2;
  // Before there are other threads, and so before it is known how many are needed.
  std::vector<std::unique_ptr<MemoryProbe>> probes;
  for (std::size_t i = 0; i < options.sequences.size() + std::size(kCameras) + 1; ++i)
    probes.push_back(std::make_unique<MemoryProbe>(two_threads));
  Columns columns = chooseInputs(options);
  probes.erase(probes.begin() + static_cast<std::ptrdiff_t>(columns.size()), probes.end() - 1);
  for (std::size_t i = 0; i < columns.size(); ++i) {
    Column& column = columns[i];
    std::cerr << "benchmark: " << column.heading() << " px\n";
    column.peak_MB = peakMemory_MB(probes[i].get(), column.input.get());
    probes[i].reset();
    column.times = measureFrames(column.input.get(), kindsFor(column, options.parameters));
  }
  std::ostringstream text = classicStream();
  text << "Means over " << columns.front().run(kTwoThreads).frames.wall_ms.size()
       << " frames, in turns with OpenCV's line segment detector (cv LSD) on one image (its "
          "median); "
       << numCores() << (numCores() == 1 ? " core, " : " cores, ") << openCvVersion()
       << ". Other systems: measured side by side on two cores.\n\n"
       << timeTable(columns) << '\n'
       << otherTable(columns) << '\n'
       << stageTable(columns) << '\n'
       << notScaling(columns);
  if (columns.front().times.yardstick.wall_ms.empty()) text << '\n' << kNoYardstick << ".\n";
  if (options.drive_m > 0.0) {
    std::cerr << "benchmark: drive of " << options.drive_m << " m\n";
    text << '\n' << driveTable(probes.back().get(), options.drive_m);
  }
  return text.str();
}

}  // namespace point_line_odometry
