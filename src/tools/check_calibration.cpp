/// \file
/// Checks how the images of a stereo camera agree with its calibration, live, in a bag, in a folder
/// or in the synthetic world, and writes a corrected calibration.

#include <filesystem>
#include <iostream>
#include <memory>
#include <opencv2/imgcodecs.hpp>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "common/input_error.h"
#include "dataset/camera_info_file.h"
#include "ros/node_parameters.h"
#include "tools/bag_source.h"
#include "tools/calibration_check.h"
#include "tools/calibration_image.h"
#include "tools/command_line.h"
#include "tools/live_source.h"
#include "tools/output_folder.h"
#include "tools/parameter_text.h"
#include "tools/source_filters.h"
#include "tools/stereo_source.h"
#include "tools/synthetic_source.h"

namespace point_line_odometry {
namespace {

namespace po = boost::program_options;

constexpr const char* kLive = "live";
constexpr int kFewestFrames = 3;  // two motions
constexpr const char* kImageName = "calibration.png";
constexpr const char* kLeftName = "left.yaml";
constexpr const char* kRightName = "right.yaml";

struct Options {
  std::string input;
  std::string output;
  bool write = false;
  std::string config;
  std::vector<std::string> settings;
  BagOptions bag;
  double max_interval_s = 0.0;
  LiveOptions live;
  CameraInfoFiles camera_infos;
  MaskRequest masks;
  long max_frames = 1000;
  long every = 1;
  bool quiet = false;
};

std::unique_ptr<StereoSource> openInput(Options options) {
  if (options.input == kLive) {
    options.live.max_interval_s = options.max_interval_s;
    return openLive(options.live);
  }
  if (isSyntheticName(options.input)) return openSynthetic(options.input);
  if (!std::filesystem::exists(options.input)) {
    throw InputError("input '" + options.input +
                     "' does not exist: name a bag, a folder, synthetic:SCENE or live");
  }
  if (std::filesystem::is_directory(options.input)) return openFolder(options.input);
  options.bag.file = options.input;
  options.bag.max_interval_ns = static_cast<std::int64_t>(options.max_interval_s * 1e9);
  return openBag(options.bag);
}

Parameters readParameters(const Options& options) {
  Parameters parameters;
  std::vector<std::string> warnings;
  if (!options.config.empty()) {
    if (!std::filesystem::is_regular_file(options.config)) {
      throw InputError("parameter file '" + options.config + "' does not exist: check the path");
    }
    parameters = loadParameters(options.config, nodeParameterNames(), &warnings);
  }
  parameters = applySettings(parameters, options.settings, &warnings);
  printWarnings("check_calibration", warnings);
  return parameters;
}

CalibrationReport measure(const Options& options) {
  const std::unique_ptr<StereoSource> source =
      everyNth(masked(calibrated(openInput(options), options.camera_infos), options.masks),
               static_cast<std::size_t>(options.every));
  const Parameters parameters = readParameters(options);
  try {
    CalibrationCheck check(source->calibration(), source->needsRectification(), parameters);
    forEachPair(*source, static_cast<std::size_t>(options.max_frames), options.quiet,
                [&](const StereoImages& images) { check.add(images); });
    if (check.frames() < kFewestFrames) {
      throw InputError("only " + std::to_string(check.frames()) + " pairs could be used of '" +
                       options.input + "': " + std::to_string(kFewestFrames) + " are needed");
    }
    return check.report();
  } catch (const std::invalid_argument& error) {
    throw InputError("calibration of '" + options.input + "' is unusable: " + error.what());
  }
}

std::string toPng(const cv::Mat& image) {
  std::vector<unsigned char> bytes;
  cv::imencode(".png", image, bytes);
  return {bytes.begin(), bytes.end()};
}

int checkCalibration(const Options& options) {
  std::unique_ptr<OutputFolder> output;
  if (!options.output.empty()) {
    output = std::make_unique<OutputFolder>(options.output);
    output->reserve(kImageName);
    for (const char* name : {kLeftName, kRightName}) {
      if (options.write) output->reserve(name);
    }
  }
  const CalibrationReport report = measure(options);
  if (output) {
    output->write(kImageName, toPng(drawCalibration(report)));
    if (options.write) {
      const StereoCalibration& corrected = report.corrected.calibration;
      output->write(kLeftName, formatCameraInfo(corrected.left, "left"));
      output->write(kRightName, formatCameraInfo(corrected.right, "right"));
    }
    output->commit();
  }
  std::cout << formatReport(report);
  return 0;
}

po::options_description describeInput(Options* options) {
  po::options_description description("Input");
  // clang-format off
  description.add_options()
      ("left-topic", po::value(&options->bag.topics.left)->value_name("TOPIC"),
       "left images of a bag; default: those in /stereo, or the only pair there is")
      ("right-topic", po::value(&options->bag.topics.right)->value_name("TOPIC"),
       "right images of a bag; default: by the name of the left ones")
      ("approximate-sync", po::value(&options->max_interval_s)->value_name("SECONDS"),
       "pair images whose stamps differ by up to this; default: equal stamps, or as the node does")
      ("ns", po::value(&options->live.name_space)->value_name("NS")->default_value("stereo"),
       "namespace of a live camera")
      ("node", po::value(&options->live.node)->value_name("NAME")->default_value("stereo_odometry"),
       "odometry node within it, whose parameters are used if it runs")
      ("rectify", po::value(&options->live.rectify)->value_name("BOOL")->implicit_value("true"),
       "use image_raw of a live camera and rectify with camera_info; default: as the node does")
      ("transport", po::value(&options->live.transport)->value_name("NAME"),
       "image transport of a live camera: raw, compressed, ...")
      ("seconds", po::value(&options->live.seconds)->value_name("S")->default_value(30.0, "30"),
       "how long to watch a live camera")
      ("left-camera-info", po::value(&options->camera_infos[0])->value_name("FILE"),
       "calibration of the left camera, a yaml file of camera_calibration, in place of the input's")
      ("right-camera-info", po::value(&options->camera_infos[1])->value_name("FILE"),
       "the same for the right camera")
      ("left-mask", po::value(&options->masks.files[0])->value_name("FILE"),
       "image of the left camera's size, 0 where its pixels are to be ignored")
      ("right-mask", po::value(&options->masks.files[1])->value_name("FILE"),
       "the same for the right camera")
      ("every", po::value(&options->every)->value_name("N"), "take every Nth frame")
      ("max-frames", po::value(&options->max_frames)->value_name("N")->default_value(1000),
       "stop after N frames");
  // clang-format on
  return description;
}

po::options_description describeOutput(Options* options) {
  po::options_description description("Odometry and output");
  // clang-format off
  description.add_options()
      ("config", po::value(&options->config)->value_name("FILE"), "parameters, YAML")
      ("set", po::value(&options->settings)->value_name("NAME=VALUE")->composing(),
       "one parameter; may be given several times, overrides --config")
      ("output,o", po::value(&options->output)->value_name("DIR"),
       "folder for calibration.png, an image of the residuals over the image")
      ("write", po::bool_switch(&options->write),
       "write DIR/left.yaml and DIR/right.yaml, the corrected calibration")
      ("quiet", po::bool_switch(&options->quiet), "no progress bar")
      ("version", "print the version and the formats that are read, and end")
      ("help,h", "print this help and end");
  // clang-format on
  return description;
}

/// Throws InputError if something is missing or out of its range.
void checkOptions(const Options& options, const po::variables_map& values) {
  if (options.input.empty()) {
    throw InputError("no input is given: name a bag, a folder, synthetic:SCENE or live");
  }
  if (options.write && options.output.empty()) {
    throw InputError("option --write needs a folder: add -o DIR");
  }
  requirePositive("--max-frames", options.max_frames, values);
  requirePositive("--every", options.every, values);
  if (!(options.max_interval_s >= 0.0) || options.max_interval_s > 1.0) {
    throw InputError("option --approximate-sync must be a number of seconds from 0 to 1");
  }
  if (!(options.live.seconds >= 1.0) || options.live.seconds > 3600.0) {
    throw InputError("option --seconds must be a number from 1 to 3600");
  }
  const std::string& rectify = options.live.rectify;
  if (!rectify.empty() && rectify != "true" && rectify != "false") {
    throw InputError("option --rectify must be true or false");
  }
}

int runCommandLine(int argc, char** argv) {
  initLive("check_calibration", &argc, argv);
  Options options;
  po::options_description visible;
  visible.add(describeInput(&options)).add(describeOutput(&options));
  po::options_description all(visible);
  all.add_options()("input", po::value(&options.input));
  const po::variables_map values = parseArguments(argc, argv, all, {"input"});
  if (values.count("help") > 0) {
    std::cout << "usage: check_calibration INPUT [-o DIR [--write]] [options]\n\n"
                 "Measures how the images of a stereo camera agree with its calibration: INPUT is\n"
                 "a bag, the folder of a KITTI or EuRoC sequence, the synthetic world\n"
                 "(synthetic:SCENE[,name=value ...], see offline_odometry) or 'live'. The camera\n"
                 "must move. The corrected calibration is for the driver of the camera, or for\n"
                 "--left-camera-info and --right-camera-info of this tool and offline_odometry.\n\n"
              << visible;
    return 0;
  }
  checkOptions(options, values);
  return checkCalibration(options);
}

}  // namespace
}  // namespace point_line_odometry

int main(int argc, char** argv) {
  return point_line_odometry::runTool("check_calibration", argc, argv,
                                      point_line_odometry::runCommandLine);
}
