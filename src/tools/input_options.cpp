#include "tools/input_options.h"

#include <cmath>
#include <cstdint>
#include <filesystem>
#include <system_error>
#include <utility>

#include "common/input_error.h"
#include "ros/node_parameters.h"
#include "tools/command_line.h"
#include "tools/parameter_text.h"
#include "tools/recorded_run.h"
#include "tools/synthetic_source.h"

namespace point_line_odometry {

namespace po = boost::program_options;

void describeInput(InputOptions* input, po::options_description* description) {
  auto* max_frames = po::value(&input->max_frames)->value_name("N");
  if (input->max_frames > 0) max_frames->default_value(input->max_frames);
  // clang-format off
  description->add_options()
      ("left-topic", po::value(&input->topics.left)->value_name("TOPIC"),
       "left images of a bag; default: those in /stereo, or the only pair there is")
      ("right-topic", po::value(&input->topics.right)->value_name("TOPIC"),
       "right images of a bag; default: by the name of the left ones")
      ("approximate-sync", po::value(&input->max_interval_s)->value_name("SECONDS"),
       "pair images whose stamps differ by up to this; default: equal stamps, or as a node does")
      ("left-camera-info", po::value(&input->camera_infos[0])->value_name("FILE"),
       "calibration of the left camera, a yaml file of camera_calibration, in place of the input's;\n"
       "images that were rectified already are rectified again by it")
      ("right-camera-info", po::value(&input->camera_infos[1])->value_name("FILE"),
       "the same for the right camera")
      ("left-mask", po::value(&input->masks.files[0])->value_name("FILE"),
       "image of the left camera's size, 0 where its pixels are to be ignored")
      ("right-mask", po::value(&input->masks.files[1])->value_name("FILE"),
       "the same for the right camera")
      ("every", po::value(&input->every)->value_name("N"), "take every Nth frame")
      ("max-frames", max_frames, "stop after N frames");
  // clang-format on
}

void describeParameters(ParameterOptions* parameters, po::options_description* description) {
  // clang-format off
  description->add_options()
      ("config", po::value(&parameters->config)->value_name("FILE"), "parameters, YAML")
      ("set", po::value(&parameters->settings)->value_name("NAME=VALUE")->composing(),
       "one parameter; may be given several times, overrides --config");
  // clang-format on
}

void checkInput(const InputOptions& input, const po::variables_map& values) {
  constexpr double kMostInterval_s = 10.0;
  requirePositive("--max-frames", input.max_frames, values);
  requirePositive("--every", input.every, values);
  if (!(input.max_interval_s >= 0.0) || input.max_interval_s > kMostInterval_s) {
    throw InputError("option --approximate-sync must be a number of seconds from 0 to 10");
  }
  std::error_code ignored;
  const bool is_folder = std::filesystem::is_directory(input.input, ignored);
  if (isRecordingName(input.input)) {
    refuseOptions(values,
                  {"left-topic", "right-topic", "approximate-sync", "imu-topic", "wheel-topic",
                   "mask-images"},
                  "bags: a recording has its own");
  }
  if (isSyntheticName(input.input) || is_folder) {
    refuseOptions(values,
                  {"left-topic", "right-topic", "approximate-sync", "imu-topic", "wheel-topic"},
                  "bags, not for '" + input.input + "'");
  }
  if (is_folder) refuseOptions(values, {"mask-images"}, "bags and the synthetic world");
}

std::unique_ptr<StereoSource> openInput(const InputOptions& input, BagOptions bag) {
  if (isSyntheticName(input.input)) return openSynthetic(input.input);
  if (!std::filesystem::exists(input.input)) {
    throw InputError("input '" + input.input +
                     "' does not exist: check the path; --help says what can be read");
  }
  if (std::filesystem::is_directory(input.input)) return openFolder(input.input);
  bag.file = input.input;
  bag.topics = input.topics;
  bag.max_interval_ns = static_cast<std::int64_t>(std::lround(input.max_interval_s * 1e9));
  return openBag(bag);
}

std::unique_ptr<StereoSource> filtered(std::unique_ptr<StereoSource> source,
                                       const InputOptions& input) {
  return everyNth(masked(calibrated(std::move(source), input.camera_infos), input.masks),
                  static_cast<std::size_t>(input.every));
}

Parameters readParameters(const char* tool, const ParameterOptions& options, Parameters defaults,
                          std::vector<std::string> warnings) {
  Parameters parameters = std::move(defaults);
  if (!options.config.empty()) {
    if (!std::filesystem::is_regular_file(options.config)) {
      throw InputError("parameter file '" + options.config + "' does not exist: check the path");
    }
    parameters = loadParameters(options.config, nodeParameterNames(), &warnings);
  }
  parameters = applySettings(parameters, options.settings, &warnings);
  printWarnings(tool, warnings);
  return parameters;
}

}  // namespace point_line_odometry
