/// \file
/// Runs the odometry over a bag, a data set folder, the synthetic world or what the flight recorder
/// wrote, as fast as it can and without a ROS master, and writes the trajectory, a table of all
/// frames and a summary.

#include <algorithm>
#include <chrono>
#include <filesystem>
#include <iomanip>
#include <iostream>
#include <memory>
#include <opencv2/imgcodecs.hpp>
#include <sstream>

#include "point_line_odometry/feature_overlay.h"
#include "point_line_odometry/stereo_odometry.h"
#include "ros/node_parameters.h"
#include "tools/bag_source.h"
#include "tools/command_line.h"
#include "tools/output_folder.h"
#include "tools/parameter_text.h"
#include "tools/progress_bar.h"
#include "tools/recording_source.h"
#include "tools/run_report.h"
#include "tools/source_filters.h"
#include "tools/stereo_source.h"
#include "tools/synthetic_source.h"

namespace point_line_odometry {
namespace {

namespace po = boost::program_options;

struct Options {
  std::string input;
  std::string output;
  std::string config;
  std::vector<std::string> settings;
  std::string left_topic;
  std::string right_topic;
  double max_interval_s = 0.0;
  long max_frames = 0;  // 0: all
  long every = 1;
  double scale = 1.0;
  long features_every = 0;  // 0: no picture
  bool quiet = false;
};

using Clock = std::chrono::steady_clock;

double elapsed_ms(Clock::time_point since) {
  return std::chrono::duration<double, std::milli>(Clock::now() - since).count();
}

/// Nothing if the input is no recording.
std::optional<RecordingReplay> openRecording(const Options& options) {
  if (!isRecordingName(options.input) || !std::filesystem::is_regular_file(options.input))
    return std::nullopt;
  return RecordingReplay(RecordingReader::read(options.input));
}

std::unique_ptr<StereoSource> openInput(const Options& options, const RecordedRun* recorded) {
  if (isSyntheticName(options.input)) return openSynthetic(options.input);
  if (!std::filesystem::exists(options.input)) {
    throw InputError("input '" + options.input +
                     "' does not exist: name a bag, a folder, a recording or synthetic:SCENE");
  }
  if (recorded != nullptr) {
    return std::make_unique<BagSource>(
        BagSource::Options{recorded->bag, recorded->topics, recorded->max_interval_ns});
  }
  if (!std::filesystem::is_directory(options.input)) {
    const auto interval_ns = static_cast<std::int64_t>(options.max_interval_s * 1e9);
    return std::make_unique<BagSource>(
        BagSource::Options{options.input, {options.left_topic, options.right_topic}, interval_ns});
  }
  return std::make_unique<FolderSource>(StereoDataset::open(options.input));
}

/// The frames of the input that are asked for, in the size that is asked for.
std::unique_ptr<StereoSource> openSource(const Options& options, const RecordedRun* recorded) {
  std::unique_ptr<StereoSource> source = openInput(options, recorded);
  if (options.every > 1) {
    source = std::make_unique<EveryNthSource>(std::move(source),
                                              static_cast<std::size_t>(options.every));
  }
  if (options.scale != 1.0) {
    source = std::make_unique<ScaledSource>(std::move(source), options.scale);
  }
  return source;
}

/// \param parameters what holds where the options name nothing else.
Parameters readParameters(const Options& options, Parameters parameters) {
  if (!options.config.empty()) {
    if (!std::filesystem::is_regular_file(options.config)) {
      throw InputError("parameter file '" + options.config + "' does not exist: check the path");
    }
    parameters = loadParameters(options.config, nodeParameterNames());
  }
  return applySettings(parameters, options.settings);
}

/// The chain from a source to the rows of its frames.
class OfflineRun {
 public:
  /// \param replay of the recording that the source is of, or null.
  OfflineRun(StereoSource& source, const Parameters& parameters, RecordingReplay* replay)
      : source_(source),
        odometry_(rectifiedCamera(source.calibration()), parameters),
        replay_(replay) {
    if (source.needsRectification()) {
      rectifier_ = std::make_unique<StereoRectifier>(source.calibration());
    }
  }

  /// Takes the next frame; false at the end of the source.
  bool step() {
    const Clock::time_point begin = Clock::now();
    std::optional<StereoImages> images = source_.next();
    if (!images) return false;
    const double decode_ms = elapsed_ms(begin);
    const Clock::time_point decoded = Clock::now();
    if (rectifier_) images = rectifier_->rectify(*images);
    const double rectify_ms = rectifier_ ? elapsed_ms(decoded) : 0.0;
    left_ = images->left;
    if (replay_ != nullptr) replay_->prepare(images->stamp_ns, &odometry_);
    result_ = odometry_.process(*images);
    if (replay_ != nullptr) replay_->compare(result_);
    rows_.push_back({{images->stamp_ns, poseOfInputCamera(result_.T_odom_camera)},
                     result_.state,
                     result_.reason,
                     result_.counts,
                     result_.rms_px,
                     result_.times,
                     decode_ms,
                     rectify_ms,
                     uncertaintyOfInputCamera(result_)});
    point_residuals_.add(result_.point_residuals);
    line_residuals_.add(result_.line_residuals);
    return true;
  }

  StereoOdometry* odometry() { return &odometry_; }
  const std::vector<FrameRow>& rows() const { return rows_; }
  const ResidualHistogram& pointResiduals() const { return point_residuals_; }
  const ResidualHistogram& lineResiduals() const { return line_residuals_; }

  /// Picture of the last frame.
  cv::Mat draw() const { return drawFeatures(left_, result_); }

 private:
  /// Pose of the camera that took the image: rectification turned it, which is undone on both sides
  /// so that the first pose is still the identity. A recording goes on from where it was in odom.
  Eigen::Isometry3d poseOfInputCamera(const Eigen::Isometry3d& T_odom_rectified) const {
    if (!rectifier_) return T_odom_rectified;
    Eigen::Isometry3d T_rectified_raw = Eigen::Isometry3d::Identity();
    T_rectified_raw.linear() = rectifier_->R_rectified_raw();
    if (replay_ != nullptr) return T_odom_rectified * T_rectified_raw;
    return T_rectified_raw.inverse() * T_odom_rectified * T_rectified_raw;
  }

  /// Twist and covariances in the axes of the camera that took the image; for a recording, the pose
  /// has those of odom.
  FrameUncertainty uncertaintyOfInputCamera(const FrameResult& result) const {
    FrameUncertainty u{result.pose_covariance, result.twist, result.twist_covariance,
                       result.twist_over_s};
    if (!rectifier_) return u;
    Matrix6d turn = Matrix6d::Zero();
    turn.topLeftCorner<3, 3>() = turn.bottomRightCorner<3, 3>() =
        rectifier_->R_rectified_raw().transpose();
    u.twist = turn * u.twist;
    u.twist_covariance = turn * u.twist_covariance * turn.transpose();
    if (replay_ == nullptr) u.pose_covariance = turn * u.pose_covariance * turn.transpose();
    return u;
  }

  StereoSource& source_;
  StereoOdometry odometry_;
  RecordingReplay* replay_;
  std::unique_ptr<StereoRectifier> rectifier_;
  cv::Mat left_;
  FrameResult result_;
  std::vector<FrameRow> rows_;
  ResidualHistogram point_residuals_;
  ResidualHistogram line_residuals_;
};

void writePicture(const std::filesystem::path& folder, std::size_t index, const cv::Mat& picture) {
  std::ostringstream name;
  name << std::setw(6) << std::setfill('0') << index << ".png";
  if (!cv::imwrite((folder / name.str()).string(), picture)) {
    throw InputError("'" + (folder / name.str()).string() +
                     "' cannot be written: make room on disk");
  }
}

std::string formatTum(const std::vector<StampedPose>& trajectory) {
  std::ostringstream text;
  writeTum(text, trajectory);
  return text.str();
}

/// The true poses of the time of a run, with those on either side of it.
std::vector<StampedPose> truthOf(const std::vector<FrameRow>& rows,
                                 const std::vector<StampedPose>& truth) {
  if (rows.empty()) return {};
  const auto earlier = [](const StampedPose& a, const StampedPose& b) {
    return a.stamp_ns < b.stamp_ns;
  };
  auto begin = std::upper_bound(truth.begin(), truth.end(), rows.front().pose, earlier);
  if (begin != truth.begin()) --begin;
  auto end = std::lower_bound(begin, truth.end(), rows.back().pose, earlier);
  if (end != truth.end()) ++end;
  return {begin, end};
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

/// The run for a source. Throws InputError if the calibration of the source cannot be used.
OfflineRun makeRun(StereoSource& source, const Options& options, RecordingReplay* replay) {
  const Parameters given =
      readParameters(options, replay != nullptr ? replay->run().parameters : Parameters());
  const Parameters& first = replay != nullptr ? replay->run().parameters : given;
  try {
    OfflineRun run(source, first, replay);
    const bool others = !options.config.empty() || !options.settings.empty();
    if (replay != nullptr)
      replay->begin(others ? std::make_optional(given) : std::nullopt, run.odometry());
    return run;
  } catch (const std::invalid_argument& error) {
    throw InputError("calibration of '" + options.input + "' is unusable: " + error.what());
  }
}

/// Takes the frames of a run, as many as are asked for, and writes the pictures that are asked for.
void process(const Options& options, const StereoSource& source, OutputFolder* output,
             OfflineRun* run) {
  const auto limit = static_cast<std::size_t>(options.max_frames);
  const auto every = static_cast<std::size_t>(options.features_every);
  std::filesystem::path pictures;
  if (every > 0) pictures = output->makeFolder("features");
  ProgressBar progress("odometry", expectedSize(source, limit), options.quiet);
  while ((limit == 0 || run->rows().size() < limit) && run->step()) {
    throwIfInterrupted();
    const std::size_t index = run->rows().size() - 1;
    if (every > 0 && index % every == 0) writePicture(pictures, index, run->draw());
    progress.step();
  }
}

int runOdometry(const Options& options) {
  std::optional<RecordingReplay> replay = openRecording(options);
  const std::unique_ptr<StereoSource> source =
      openSource(options, replay ? &replay->run() : nullptr);
  OfflineRun run = makeRun(*source, options, replay ? &*replay : nullptr);
  const std::vector<StampedPose> truth = source->groundTruth();
  OutputFolder output(options.output);
  for (const char* name :
       {"trajectory.tum", "trajectory.kitti", "frames.csv", "uncertainty.csv", "summary.json"}) {
    output.reserve(name);
  }
  const Clock::time_point begin = Clock::now();
  process(options, *source, &output, &run);
  RunInfo info;
  info.input = options.input;
  info.line_detector = toString(run.odometry()->lineDetector());
  const PointParameters& points = run.odometry()->parameters().points;
  info.point_descriptor = points.enabled ? points.descriptor : "none";
  info.unpaired_images = source->unpaired();
  info.wall_s = elapsed_ms(begin) / 1000.0;
  info.point_residuals = run.pointResiduals();
  info.line_residuals = run.lineResiduals();
  info.parameters = run.odometry()->parameters();
  if (replay) info.recording = replay->comparison();
  writeReport(run.rows(), info, &output);
  if (truth.empty()) {
    output.discard("groundtruth.tum");
  } else {
    output.reserve("groundtruth.tum");
    output.write("groundtruth.tum", formatTum(truthOf(run.rows(), truth)));
  }
  output.commit();
  if (!options.quiet) std::cout << formatTable(run.rows(), info);
  return 0;
}

/// The tables in README: what the node reads when it starts, and what may change while it runs.
std::string formatAllParameters() {
  ParameterRows node;
  const NodeParameters defaults;
  visitNodeParameters(defaults, node);
  return "The core, here with `--set`; these may be changed while the node runs:\n\n" +
         formatParameterTable() + "\nThe node; these are read when it starts:\n\n" +
         formatMarkdownTable(node.rows);
}

int runCommandLine(int argc, char** argv) {
  Options options;
  po::options_description visible("Options");
  // clang-format off
  visible.add_options()
      ("output,o", po::value(&options.output)->value_name("DIR"), "folder for the results")
      ("config", po::value(&options.config)->value_name("FILE"), "parameters, YAML")
      ("set", po::value(&options.settings)->value_name("NAME=VALUE")->composing(),
       "one parameter; may be given several times, stronger than --config")
      ("left-topic", po::value(&options.left_topic)->value_name("TOPIC"),
       "left images of a bag; default: those in /stereo, or the only pair there is")
      ("right-topic", po::value(&options.right_topic)->value_name("TOPIC"),
       "right images of a bag; default: by the name of the left ones")
      ("approximate-sync", po::value(&options.max_interval_s)->value_name("SECONDS"),
       "pair images of a bag whose stamps differ by up to this; default: equal stamps")
      ("every", po::value(&options.every)->value_name("N"), "take every Nth frame")
      ("scale", po::value(&options.scale)->value_name("FACTOR"),
       "take the images FACTOR times as large, 0.1 to 10")
      ("max-frames", po::value(&options.max_frames)->value_name("N"), "stop after N frames")
      ("features-images", po::value(&options.features_every)->value_name("N"),
       "write a picture of the features of every Nth frame to DIR/features")
      ("quiet", po::bool_switch(&options.quiet), "no progress bar and no table")
      ("print-parameters", "print the tables of parameters (Markdown) and end")
      ("help,h", "print this help and end");
  // clang-format on
  po::options_description all(visible);
  all.add_options()("input", po::value(&options.input));
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
  if (options.input.empty()) throw InputError("no input is given: name a bag or a folder");
  if (options.output.empty()) throw InputError("no output folder is given: add -o DIR");
  requirePositive("--max-frames", options.max_frames, values);
  requirePositive("--every", options.every, values);
  if (!(options.scale >= 0.1 && options.scale <= 10.0)) {
    throw InputError("option --scale must be a number from 0.1 to 10");
  }
  requirePositive("--features-images", options.features_every, values);
  if (!(options.max_interval_s >= 0.0) || options.max_interval_s > 10.0) {
    throw InputError("option --approximate-sync must be a number of seconds from 0 to 10");
  }
  return runOdometry(options);
}

}  // namespace
}  // namespace point_line_odometry

int main(int argc, char** argv) {
  return point_line_odometry::runTool(
      "offline_odometry", [&] { return point_line_odometry::runCommandLine(argc, argv); });
}
