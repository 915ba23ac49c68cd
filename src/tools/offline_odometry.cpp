/// \file
/// Runs the odometry on a bag, a data set folder, the synthetic world or a recording of the flight
/// recorder, as fast as possible and without a ROS master, and writes the trajectory, a table of
/// all frames and a summary.

#include <algorithm>
#include <chrono>
#include <filesystem>
#include <iomanip>
#include <iostream>
#include <memory>
#include <opencv2/imgcodecs.hpp>
#include <sstream>
#include <utility>

#include "common/input_error.h"
#include "point_line_odometry/parameters.h"
#include "ros/node_parameters.h"
#include "tools/command_line.h"
#include "tools/input_options.h"
#include "tools/interruption.h"
#include "tools/offline_run.h"
#include "tools/output_folder.h"
#include "tools/parameter_text.h"
#include "tools/progress_bar.h"
#include "tools/recorded_run.h"
#include "tools/recording_replay.h"
#include "tools/report_script.h"
#include "tools/run_report.h"
#include "tools/stereo_source.h"
#include "tools/thumbnails.h"

namespace point_line_odometry {
namespace {

namespace po = boost::program_options;

/// What the tool returns when the results are complete but the report could not be made.
constexpr int kExitNoReport = 1;

struct Options {
  InputOptions input;
  std::string wheel_topic;
  std::string imu_topic;
  double scale = 1.0;
  std::string priors;
  ParameterOptions parameters;
  double target_ms = 0.0;  // 0: none
  std::string output;
  long features_every = 0;  // 0: no images
  bool report = false;
  bool quiet = false;
};

using Clock = std::chrono::steady_clock;

/// Nothing if the input is not a recording.
std::optional<RecordingReplay> openRecording(const std::string& input) {
  if (!isRecordingName(input) || !std::filesystem::is_regular_file(input)) return std::nullopt;
  return RecordingReplay(readRecording(input));
}

/// The input, or the bag of a recording, with the requested calibration, masks, frames and image
/// size.
std::unique_ptr<StereoSource> openSource(const Options& options, const RecordedRun* recorded) {
  InputOptions input = options.input;
  BagOptions bag;
  bag.wheel_topic = options.wheel_topic;
  bag.imu_topic = options.imu_topic;
  bag.masks = input.masks.of_source;
  std::unique_ptr<StereoSource> source;
  if (recorded != nullptr) {
    input.masks.of_source = true;
    bag.file = recorded->bag;
    bag.topics = recorded->topics;
    bag.max_interval_ns = recorded->max_interval_ns;
    bag.masks = recorded->has_masks;
    source = openBag(bag);
  } else {
    source = openInput(input, bag);
  }
  source = filtered(std::move(source), input);
  if (options.scale != 1.0) source = scaled(std::move(source), options.scale);
  return source;
}

void writeImage(const std::filesystem::path& folder, std::size_t index, const cv::Mat& image) {
  std::ostringstream name;
  name << std::setw(6) << std::setfill('0') << index << ".png";
  if (!cv::imwrite((folder / name.str()).string(), image)) {
    throw InputError("'" + (folder / name.str()).string() +
                     "' cannot be written: make room on disk");
  }
}

std::string formatTum(const std::vector<StampedPose>& trajectory) {
  std::ostringstream text;
  writeTum(text, trajectory);
  return text.str();
}

/// The true poses for the time of a run, with the nearest ones before and after it.
std::vector<StampedPose> groundTruthOf(const std::vector<FrameRow>& rows,
                                       const std::vector<StampedPose>& ground_truth) {
  if (rows.empty()) return {};
  const auto earlier = [](const StampedPose& a, const StampedPose& b) {
    return a.stamp_ns < b.stamp_ns;
  };
  auto begin =
      std::upper_bound(ground_truth.begin(), ground_truth.end(), rows.front().pose, earlier);
  if (begin != ground_truth.begin()) --begin;
  auto end = std::lower_bound(begin, ground_truth.end(), rows.back().pose, earlier);
  if (end != ground_truth.end()) ++end;
  std::vector<StampedPose> poses;
  for (auto pose = begin; pose != end; ++pose) {  // frames that are refused have one, too
    if (poses.empty() || pose->stamp_ns > poses.back().stamp_ns) poses.push_back(*pose);
  }
  return poses;
}

void writeReport(const std::vector<FrameRow>& rows, const RunInfo& info, OutputFolder* output) {
  std::vector<StampedPose> trajectory;
  for (const FrameRow& row : rows) trajectory.push_back(row.pose);
  std::ostringstream kitti;
  writeKitti(kitti, trajectory);
  output->write("trajectory.tum", formatTum(trajectory));
  output->write("trajectory.kitti", kitti.str());
  output->write("frames.csv", formatFramesCsv(rows));
  output->write("uncertainty.csv", formatUncertaintyCsv(rows));
  output->write("summary.json", formatSummaryJson(rows, info));
}

/// Creates the run for a source. Throws InputError if the calibration of the source cannot be used.
OfflineRun makeRun(StereoSource& source, const Options& options, RecordingReplay* replay) {
  const Parameters given = replay != nullptr
                               ? readParameters("offline_odometry", options.parameters,
                                                replay->run().parameters, replay->run().warnings)
                               : readParameters("offline_odometry", options.parameters);
  const Parameters& first = replay != nullptr ? replay->run().parameters : given;
  try {
    OfflineRun run(source, first, replay);
    if (replay != nullptr && options.target_ms > 0.0)
      throw InputError(
          "option --target-frame-time cannot be used for a recording: it is replayed exactly");
    if (replay != nullptr && options.scale != 1.0)
      throw InputError(
          "option --scale cannot be used for a recording: its state is of the recorded size");
    run.setTargetFrameTime(options.target_ms);
    if (replay != nullptr && !options.priors.empty())
      throw InputError("option --priors cannot be used for a recording: it has its own");
    if (!options.priors.empty()) run.setPriors(readPriors(options.priors));
    if (replay != nullptr)
      replay->begin(options.parameters.given() ? std::make_optional(given) : std::nullopt,
                    run.odometry());
    return run;
  } catch (const std::invalid_argument& error) {
    throw InputError("calibration of '" + options.input.input + "' is unusable: " + error.what());
  }
}

/// Processes the requested frames of a run and writes the requested images.
void process(const Options& options, const StereoSource& source, OutputFolder* output,
             OfflineRun* run) {
  const auto limit = static_cast<std::size_t>(options.input.max_frames);
  const auto every = static_cast<std::size_t>(options.features_every);
  std::filesystem::path images_folder;
  if (every > 0) images_folder = output->makeFolder("features");
  std::filesystem::path thumbnails_folder;
  if (options.report) thumbnails_folder = output->makeFolder("thumbnails");
  Thumbnails thumbnails;
  ProgressBar progress("odometry", expectedSize(source, limit), options.quiet);
  while ((limit == 0 || run->rows().size() < limit)) {
    const std::size_t index = run->rows().size();
    if (!run->step()) break;
    throwIfInterrupted();
    if (run->rows().size() == index) continue;  // refused
    if (every > 0 && index % every == 0) writeImage(images_folder, index, run->draw());
    if (options.report)
      thumbnails.offer(index, run->rows().back().state, [run] { return run->draw(); });
    progress.step();
  }
  if (options.report) thumbnails.write(thumbnails_folder.string());
}

/// What the user should know before the results are used.
std::vector<std::string> warningsOf(const StereoSource& source, const OfflineRun& run) {
  std::vector<std::string> warnings = source.warnings();
  for (const auto& [reason, count] : run.refused()) {
    warnings.push_back(std::to_string(count) +
                       " frames were not accepted by the odometry: " + toString(reason));
  }
  const bool any_ok = std::any_of(run.rows().begin(), run.rows().end(), [](const FrameRow& row) {
    return row.state == TrackingState::kOk;
  });
  if (!any_ok && run.rows().size() > 1)
    warnings.emplace_back("the motion of no frame is known: frames.csv has the reasons");
  return warnings;
}

int runOdometry(const Options& options) {
  std::optional<RecordingReplay> replay = openRecording(options.input.input);
  const std::unique_ptr<StereoSource> source =
      openSource(options, replay ? &replay->run() : nullptr);
  OfflineRun run = makeRun(*source, options, replay ? &*replay : nullptr);
  const std::vector<StampedPose> ground_truth = source->groundTruth();
  OutputFolder output(options.output, filesOfEarlierRun(options.output));
  for (const char* name :
       {"trajectory.tum", "trajectory.kitti", "frames.csv", "uncertainty.csv", "summary.json"}) {
    output.reserve(name);
  }
  if (!ground_truth.empty()) output.reserve("groundtruth.tum");
  if (options.report) output.requireOwn("report.html");
  const Clock::time_point begin = Clock::now();
  process(options, *source, &output, &run);
  RunInfo info;
  info.input = options.input.input;
  info.line_detector = toString(run.odometry()->lineDetector());
  const PointParameters& points = run.odometry()->parameters().points;
  info.point_descriptor = points.enabled ? points.descriptor : "none";
  info.correction_px = run.odometry()->correction().rmsPx(run.odometry()->camera());
  info.unsynchronized_images = source->unsynchronized();
  info.refused = run.refused();
  info.files = output.names();
  info.warnings = warningsOf(*source, run);
  printWarnings("offline_odometry", info.warnings);
  info.wall_s = std::chrono::duration<double>(Clock::now() - begin).count();
  info.point_residuals = run.pointResiduals();
  info.line_residuals = run.lineResiduals();
  info.parameters = run.odometry()->parameters();
  info.gyroscope = run.gyroscope();
  info.gravity = run.gravity();
  info.prior_file = run.priorFileUse(options.input.max_frames > 0);
  if (info.prior_file)
    printWarnings("offline_odometry",
                  unmatchedRows(*info.prior_file, options.priors, run.stamps()));
  if (replay) info.recording = replay->comparison();
  writeReport(run.rows(), info, &output);
  if (!ground_truth.empty())
    output.write("groundtruth.tum", formatTum(groundTruthOf(run.rows(), ground_truth)));
  output.commit();
  if (!options.quiet) std::cout << formatTable(run.rows(), info);
  if (!options.report) return 0;
  std::cout.flush();
  const std::string problem = makeReport(options.output);
  if (problem.empty()) return 0;
  std::cerr << "offline_odometry: the results are complete, but have no report.html: " << problem
            << '\n';
  return kExitNoReport;
}

/// The tables of doc/parameters.md: parameters of the core and of the node.
std::string formatAllParameters() {
  ParameterRows node;
  const NodeParameters defaults;
  visitNodeParameters(defaults, node);
  return "The core, here with `--set`; these may be changed while the node runs:\n\n" +
         formatParameterTable() + "\nThe node; these are read when it starts:\n\n" +
         formatMarkdownTable(node.rows);
}

po::options_description describeInput(Options* options) {
  po::options_description description("Input");
  describeInput(&options->input, &description);
  // clang-format off
  description.add_options()
      ("mask-images", po::bool_switch(&options->input.masks.of_source),
       "use the masks that come with the images: on the topics left/mask_image and\n"
       "right/mask_image of a bag, beside the images', or of the synthetic world's bonnet")
      ("wheel-topic",
       po::value(&options->wheel_topic)->value_name("TOPIC")->default_value("/wheel_odom"),
       "nav_msgs/Odometry of a bag by wheels, for wheels/enabled")
      ("imu-topic", po::value(&options->imu_topic)->value_name("TOPIC"),
       "sensor_msgs/Imu of a bag, for imu/enabled; default: NS/imu beside the images, or the only\n"
       "one there is")
      ("scale", po::value(&options->scale)->value_name("FACTOR"),
       "scale the images by FACTOR, 0.1 to 10")
      ("priors", po::value(&options->priors)->value_name("FILE"),
       "motion priors of frames, a row each: 'from_s to_s tx ty tz qx qy qz qw stx sty stz srx sry\n"
       "srz', the motion of the left camera between two stamps [m] and its standard deviations\n"
       "[m, rad] along and about the axes of the first, 0: unknown; the stamps, to the nanosecond,\n"
       "are those of two frames in succession: rows that match none are named");
  // clang-format on
  return description;
}

po::options_description describeOdometry(Options* options) {
  po::options_description description("Odometry");
  describeParameters(&options->parameters, &description);
  // clang-format off
  description.add_options()
      ("target-frame-time", po::value(&options->target_ms)->value_name("MS"),
       "use fewer features, and track every second frame by landmarks alone, while frames take\n"
       "longer on the mean, as the node with target_frame_time_ms;\n"
       "the result then depends on the computer");
  // clang-format on
  return description;
}

po::options_description describeOutput(Options* options) {
  po::options_description description("Output");
  // clang-format off
  description.add_options()
      ("output,o", po::value(&options->output)->value_name("DIR"), "folder for the results")
      ("features-images", po::value(&options->features_every)->value_name("N"),
       "write an image of the features of every Nth frame to DIR/features")
      ("report", po::bool_switch(&options->report),
       "write DIR/report.html, a page with all about the run: see report_run --help; needs python3\n"
       "with matplotlib")
      ("quiet", po::bool_switch(&options->quiet), "no progress bar and no table")
      ("print-parameters", "print the tables of parameters (Markdown) and end")
      ("version", "print the version and the formats that are read, and end")
      ("help,h", "print this help and end");
  // clang-format on
  return description;
}

/// Throws InputError if something is missing or out of its range.
void checkOptions(const Options& options, const po::variables_map& values) {
  if (options.input.input.empty()) throw InputError("no input is given: name a bag or a folder");
  if (options.output.empty()) throw InputError("no output folder is given: add -o DIR");
  checkInput(options.input, values);
  if (!(options.scale >= 0.1 && options.scale <= 10.0)) {
    throw InputError("option --scale must be a number from 0.1 to 10");
  }
  if (!(options.target_ms >= 0.0 && options.target_ms <= 10000.0)) {
    throw InputError("option --target-frame-time must be a number of milliseconds from 0 to 10000");
  }
  requirePositive("--features-images", options.features_every, values);
}

int runCommandLine(int argc, char** argv) {
  Options options;
  po::options_description visible;
  visible.add(describeInput(&options))
      .add(describeOdometry(&options))
      .add(describeOutput(&options));
  po::options_description all(visible);
  all.add_options()("input", po::value(&options.input.input));
  const po::variables_map values = parseArguments(argc, argv, all, {"input"});
  if (values.count("help") > 0) {
    std::cout << "usage: offline_odometry INPUT -o DIR [options]\n\n"
                 "Runs the stereo odometry over INPUT, a bag, the folder of a KITTI or EuRoC\n"
                 "sequence or the synthetic world, and writes to DIR: trajectory.tum,\n"
                 "trajectory.kitti, frames.csv, uncertainty.csv, summary.json and, where the true\n"
                 "motion is known, groundtruth.tum. Poses are of the left camera, the first\n"
                 "estimate is identity.\n"
                 "The yaml of a recording of the nodelet is replayed from the state in which it\n"
                 "began, with its parameters where no others are given, and compared; its poses\n"
                 "are in odom.\n"
                 "The synthetic world: synthetic:SCENE[,name=value ...], for example\n"
                 "synthetic:street,seed=7,frames=400; 'synthetic_world --help' has the options.\n\n"
              << visible;
    return 0;
  }
  if (values.count("print-parameters") > 0) {
    std::cout << formatAllParameters();
    return 0;
  }
  checkOptions(options, values);
  return runOdometry(options);
}

}  // namespace
}  // namespace point_line_odometry

int main(int argc, char** argv) {
  return point_line_odometry::runTool("offline_odometry", argc, argv,
                                      point_line_odometry::runCommandLine);
}
