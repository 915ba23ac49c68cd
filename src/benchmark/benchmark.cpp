/// \file
/// Measures the speed of the odometry and of its stages, and the quality of its line detector,
/// relative to OpenCV's detectors in the same run.

#include <benchmark/benchmark.h>

#include <algorithm>
#include <cstdlib>
#include <filesystem>
#include <iostream>
#include <memory>
#include <set>
#include <string>
#include <vector>

#include "benchmark/frame_row.h"
#include "benchmark/inputs.h"
#include "benchmark/quality_rows.h"
#include "benchmark/row_timer.h"
#include "benchmark/stage_rows.h"
#include "benchmark/summary.h"
#include "common/input_error.h"
#include "tools/command_line.h"
#include "tools/output_folder.h"
#include "tools/parameter_text.h"

namespace point_line_odometry {
namespace {

namespace po = boost::program_options;

constexpr const char* kDataVariable = "POINT_LINE_ODOMETRY_DATA";
constexpr const char* kTheirPrefix = "--benchmark_";
constexpr const char* kOutputFlag = "--benchmark_out=";
constexpr std::size_t kWorldRun = 20;  // frames rendered of each scene

constexpr const char* kHelp =
    R"(usage: benchmark [--data FOLDER ...] [options] [options of Google Benchmark]
       benchmark [--data FOLDER ...] --summary [--drive METRES]

Measures the stages of the odometry and the whole of it, on a street and in rooms
of the synthetic world and on the KITTI or EuRoC sequences given by --data; without
--data on those in the folder that POINT_LINE_ODOMETRY_DATA names, if it is set. Each
of these inputs takes about half a minute. A folder that holds sequences stands for
all of them.

--summary prints the speed of the whole odometry as tables in Markdown, beside goals
and other systems: a frame on two threads, on one and on all cores, its spread,
processor time, memory of the odometry in a process of its own, larger images, and the
stages, with those that threads do not speed up. One sequence of KITTI's size of images
and one of EuRoC's are used, and the built-in street and rooms where there is none. It
takes two minutes; other programs should rest. --drive METRES adds the memory along a
drive through the built-in street (1000 m: some minutes).

Each row is INPUT/WHAT. Between its calls a row calls OpenCV's line segment detector
(LSD_REFINE_STD, one thread, one image), as computers differ and drift.
  Time, CPU    mean time of a call, by the clock and of the processor [ms]
  median_ms    median time of a call; p95_ms: 95 % of the calls take less
  vs_lsd       mean over that of OpenCV's line segment detector in the same row
  cpu_vs_lsd   the same of the processor's time in all threads, which other programs
               that run at the same time hardly change
  found        how many segments, points, matches ... the call has found
Letters after a number are powers of 1000: m thousandths, k thousands.

Stages run on one thread, except features_stereo (both images). INPUT/frame is the
whole odometry over consecutive frames; found: inliers, ok: share of the frames with
a motion, the others: mean of each stage [ms].

INPUT/segments compares the segments longer than 20 px with those of OpenCV's
detector, over up to 10 pairs spread over the sequence: all, and the n longest of
each, n the number of the one that finds fewer. Points along the segments are tracked
to the other images. The time is that of a detection, at full size unless
lines/coarse_to_fine_points is 0.
  segments, length_px   number in an image, and their total length
  right, next           share found again in the right image and in the next frame:
                        within 2 px, 5 deg and with half of the length in common
  right_tracked, next_tracked   share that could be tracked there and is counted
  offset_rms, offset_med        distance of the segments from the sub-pixel edge [px];
                        OpenCV's all lie about 0.1 px too far up and left
  on_edge               share of the segments' pixels that have a clear edge within 3 px

A warning that "Library was built as DEBUG" speaks of Google Benchmark, as Debian
builds it, and does not matter: each call is timed here.

Of the options of Google Benchmark these are useful:
  --benchmark_filter=REGEX    rows to run, for example kitti.*/frame
  --benchmark_list_tests      print the names of the rows and end
  --benchmark_out=FILE        write the table to FILE as well, as JSON
  --benchmark_min_time=S      seconds for a row of a stage, default 0.3
  --benchmark_repetitions=N   run each row N times; mean, median, standard deviation

)";

struct Options {
  std::vector<std::string> data;
  std::vector<std::string> settings;
  long frames = 0;
  bool summary = false;
  double drive_m = 0.0;
};

/// Arguments of Google Benchmark and our own; argv[0] is in both.
struct Arguments {
  std::vector<std::string> theirs;
  std::vector<const char*> ours;
  bool has_theirs = false;  // given by the user

  Arguments(int argc, char** argv) : theirs{argv[0]}, ours{argv[0]} {
    // The user's flags come later and override these.
    theirs.emplace_back("--benchmark_counters_tabular=true");
    theirs.emplace_back("--benchmark_min_time=0.3");
    for (int i = 1; i < argc; ++i) {
      if (std::string(argv[i]).rfind(kTheirPrefix, 0) == 0) {
        theirs.emplace_back(argv[i]);
        has_theirs = true;
      } else {
        ours.push_back(argv[i]);
      }
    }
  }
};

/// The file of --benchmark_out, renamed from NAME.part when it is complete.
class ResultFile {
 public:
  /// Makes Google Benchmark write under a temporary name.
  explicit ResultFile(std::vector<std::string>* arguments) {
    const std::string flag = kOutputFlag;
    for (std::string& argument : *arguments) {
      if (argument.rfind(flag, 0) != 0) continue;
      const std::filesystem::path file = std::filesystem::absolute(argument.substr(flag.size()));
      if (!file.has_filename()) throw InputError("option --benchmark_out is given no file name");
      folder_ = std::make_unique<OutputFolder>(file.parent_path().string());
      folder_->reserve(file.filename().string());
      argument += ".part";
    }
  }

  void commit() {
    if (folder_) folder_->commit();
  }

 private:
  std::unique_ptr<OutputFolder> folder_;
};

/// Passes Google Benchmark its arguments. Throws InputError for unknown ones.
void initializeBenchmark(std::vector<std::string>* arguments) {
  std::vector<char*> pointers;
  for (std::string& argument : *arguments) pointers.push_back(argument.data());
  int count = static_cast<int>(pointers.size());
  pointers.push_back(nullptr);
  ::benchmark::Initialize(&count, pointers.data());
  if (count > 1) {
    throw InputError("option " + std::string(pointers[1]) +
                     " is unknown to Google Benchmark or its value does not fit; see --help");
  }
}

using Inputs = std::vector<std::unique_ptr<BenchmarkInput>>;

/// Those of --data, or else of the variable.
std::vector<std::string> sequenceFolders(const Options& options) {
  const char* data = std::getenv(kDataVariable);
  if (options.data.empty() && data != nullptr && *data != '\0') return findSequences(data);
  std::vector<std::string> folders;
  for (const std::string& folder : options.data) {
    const std::vector<std::string> within = sequencesWithin(folder);
    folders.insert(folders.end(), within.begin(), within.end());
    if (within.empty()) folders.push_back(folder);
  }
  return folders;
}

Inputs openInputs(const Options& options) {
  Inputs inputs;
  std::set<std::string> names;
  for (const char* scene : {"street", "indoor"}) {
    inputs.push_back(BenchmarkInput::fromWorld(scene, kWorldRun));
    names.insert(scene);
  }
  for (const std::string& folder : sequenceFolders(options)) {
    inputs.push_back(BenchmarkInput::fromFolder(folder, static_cast<std::size_t>(options.frames)));
    if (!names.insert(inputs.back()->name()).second) {
      throw InputError("there are two inputs of the name '" + inputs.back()->name() +
                       "': rename the folder '" + folder + "'");
    }
  }
  return inputs;
}

void printSummary(const Options& options, const Parameters& parameters,
                  const Arguments& arguments) {
  if (arguments.has_theirs)
    throw InputError("--summary takes no options of Google Benchmark: leave --benchmark_... out");
  SummaryOptions summary;
  summary.sequences = sequenceFolders(options);
  summary.frames = static_cast<std::size_t>(options.frames);
  summary.drive_m = options.drive_m;
  summary.parameters = parameters;
  std::cout << summarize(summary);
}

int runCommandLine(int argc, char** argv) {
  Options options;
  po::options_description visible("Options");
  // clang-format off
  visible.add_options()
      ("data", po::value(&options.data)->value_name("FOLDER")->multitoken()->composing(),
       "KITTI or EuRoC sequence, or folder of sequences; several may be given")
      ("frames", po::value(&options.frames)->value_name("N")->default_value(50),
       "consecutive frames of a sequence for INPUT/frame and --summary, kept in memory")
      ("set", po::value(&options.settings)->value_name("NAME=VALUE")->composing(),
       "one parameter of the odometry; may be given several times")
      ("summary", po::bool_switch(&options.summary), "print the tables of the whole odometry")
      ("drive", po::value(&options.drive_m)->value_name("METRES"),
       "with --summary: memory along a drive")
      ("version", "print the version and the formats that are read, and end")
      ("help,h", "print this help and end");
  // clang-format on
  Arguments arguments(argc, argv);
  const po::variables_map values =
      parseArguments(static_cast<int>(arguments.ours.size()), arguments.ours.data(), visible, {});
  if (values.count("help") > 0) {
    std::cout << kHelp << visible;
    return 0;
  }
  constexpr auto kFewest = static_cast<long>(BenchmarkInput::kMinFrames);
  if (options.frames < kFewest) {
    throw InputError("option --frames is " + std::to_string(options.frames) + ", but must be " +
                     std::to_string(kFewest) + " or more");
  }
  if (values.count("drive") > 0 &&
      !(options.summary && options.drive_m >= 1.0 && options.drive_m <= 1e5))
    throw InputError("option --drive needs --summary and a number of metres from 1 to 100000");
  std::vector<std::string> warnings;
  const Parameters parameters = applySettings(Parameters(), options.settings, &warnings);
  printWarnings("benchmark", warnings);
  if (options.summary) {
    printSummary(options, parameters, arguments);
    return 0;
  }
  const Inputs inputs = openInputs(options);
  for (const auto& input : inputs) {
    registerStageRows(input.get(), parameters);
    registerFrameRow(input.get(), parameters);
    registerQualityRows(input.get(), parameters);
  }
  ResultFile results(&arguments.theirs);
  initializeBenchmark(&arguments.theirs);
  std::cerr << openCvVersion() << '\n';
  if (::benchmark::RunSpecifiedBenchmarks() == 0) {
    throw InputError(
        "no row fits --benchmark_filter: --benchmark_list_tests shows those there are");
  }
  results.commit();
  return 0;
}

}  // namespace
}  // namespace point_line_odometry

int main(int argc, char** argv) {
  return point_line_odometry::runTool("benchmark", argc, argv, point_line_odometry::runCommandLine);
}
