/// \file
/// Checks how the images of a stereo camera agree with its calibration, live, in a bag, in a folder
/// or in the synthetic world, and writes a corrected calibration.

#include <iostream>
#include <memory>
#include <opencv2/imgcodecs.hpp>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "common/input_error.h"
#include "dataset/camera_info_file.h"
#include "tools/calibration_check.h"
#include "tools/calibration_image.h"
#include "tools/command_line.h"
#include "tools/input_options.h"
#include "tools/live_source.h"
#include "tools/output_folder.h"
#include "tools/stereo_source.h"

namespace point_line_odometry {
namespace {

namespace po = boost::program_options;

constexpr const char* kLive = "live";
constexpr int kFewestFrames = 3;  // two motions
constexpr int kExitDisagrees = 1;
constexpr const char* kImageName = "calibration.png";
constexpr const char* kLeftName = "left.yaml";
constexpr const char* kRightName = "right.yaml";

struct Options {
  InputOptions input;
  ParameterOptions parameters;
  LiveOptions live;
  std::string output;
  bool write = false;
  bool quiet = false;

  Options() { input.max_frames = 1000; }
};

std::unique_ptr<StereoSource> open(const Options& options) {
  if (options.input.input != kLive) return openInput(options.input);
  LiveOptions live = options.live;
  live.max_interval_s = options.input.max_interval_s;
  return openLive(live);
}

CalibrationReport measure(const Options& options) {
  const std::unique_ptr<StereoSource> source = filtered(open(options), options.input);
  const Parameters parameters = readParameters("check_calibration", options.parameters);
  try {
    CalibrationCheck check(source->calibration(), source->needsRectification(), parameters);
    forEachPair(*source, static_cast<std::size_t>(options.input.max_frames), options.quiet,
                [&](const StereoImages& images) { check.add(images); });
    printWarnings("check_calibration", source->warnings());
    if (check.frames() < kFewestFrames) {
      throw InputError("only " + std::to_string(check.frames()) + " pairs could be used of '" +
                       options.input.input + "': " + std::to_string(kFewestFrames) + " are needed");
    }
    return check.report();
  } catch (const std::invalid_argument& error) {
    throw InputError("calibration of '" + options.input.input + "' is unusable: " + error.what());
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
  const bool write = options.write && report.agrees;
  if (output) {
    output->write(kImageName, toPng(drawCalibration(report)));
    for (const char* name : {kLeftName, kRightName}) {
      if (options.write && !write) output->release(name);
    }
    if (write) {
      const StereoCalibration& corrected = report.corrected.calibration;
      output->write(kLeftName, formatCameraInfo(corrected.left, "left"));
      output->write(kRightName, formatCameraInfo(corrected.right, "right"));
    }
    output->commit();
  }
  std::cout << formatReport(report);
  if (report.agrees) return 0;
  if (options.write) std::cout << "no calibration is written\n";
  return kExitDisagrees;
}

po::options_description describeLive(LiveOptions* live) {
  po::options_description description("Live");
  // clang-format off
  description.add_options()
      ("ns", po::value(&live->name_space)->value_name("NS")->default_value("stereo"),
       "namespace of the camera")
      ("node", po::value(&live->node)->value_name("NAME")->default_value("stereo_odometry"),
       "odometry node within it, whose parameters are used if it runs")
      ("rectify", po::value(&live->rectify)->value_name("BOOL")->implicit_value("true"),
       "use image_raw and rectify with camera_info; default: as the node does")
      ("transport", po::value(&live->transport)->value_name("NAME"),
       "image transport: raw, compressed, ...")
      ("seconds", po::value(&live->seconds)->value_name("S")->default_value(30.0, "30"),
       "how long to watch");
  // clang-format on
  return description;
}

po::options_description describeOutput(Options* options) {
  po::options_description description("Odometry and output");
  describeParameters(&options->parameters, &description);
  // clang-format off
  description.add_options()
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
  if (options.input.input.empty()) {
    throw InputError("no input is given: name a bag, a folder, synthetic:SCENE or live");
  }
  if (options.write && options.output.empty()) {
    throw InputError("option --write needs a folder: add -o DIR");
  }
  checkInput(options.input, values);
  if (options.input.input == kLive) {
    refuseOptions(values, {"left-topic", "right-topic"},
                  "bags; remap the names of a live camera: /stereo/left/image_rect:=TOPIC");
  } else {
    refuseOptions(values, {"ns", "node", "rectify", "transport", "seconds"}, "the input 'live'");
  }
  if (options.input.input == kLive && options.input.max_interval_s > 1.0) {
    throw InputError("option --approximate-sync of a live camera must be at most 1 second");
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
  po::options_description input("Input");
  describeInput(&options.input, &input);
  visible.add(input).add(describeLive(&options.live)).add(describeOutput(&options));
  po::options_description all(visible);
  all.add_options()("input", po::value(&options.input.input));
  const po::variables_map values = parseArguments(argc, argv, all, {"input"});
  if (values.count("help") > 0) {
    std::cout << "usage: check_calibration INPUT [-o DIR [--write]] [options]\n\n"
                 "Measures how the images of a stereo camera agree with its calibration: INPUT is\n"
                 "a bag, the folder of a KITTI or EuRoC sequence, the synthetic world\n"
                 "(synthetic:SCENE[,name=value ...], see offline_odometry) or 'live'. The camera\n"
                 "must move. The corrected calibration is for the driver of the camera, or for\n"
                 "--left-camera-info and --right-camera-info of this tool and offline_odometry.\n"
                 "Exit code 1: it does not agree, and the images cannot correct it.\n\n"
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
