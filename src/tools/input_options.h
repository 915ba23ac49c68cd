#pragma once

/// \file
/// What the tools that run over a sequence take alike: the sequence, and the parameters.

#include <boost/program_options/options_description.hpp>
#include <boost/program_options/variables_map.hpp>
#include <memory>
#include <string>
#include <vector>

#include "point_line_odometry/parameters.h"
#include "tools/bag_source.h"
#include "tools/source_filters.h"
#include "tools/stereo_source.h"

namespace point_line_odometry {

/// A sequence, as the user names it.
struct InputOptions {
  std::string input;  ///< a bag, the folder of a data set, or synthetic:SCENE
  StereoTopics topics;
  double max_interval_s = 0.0;  ///< see BagOptions
  CameraInfoFiles camera_infos;
  MaskRequest masks;
  long every = 1;
  long max_frames = 0;  ///< 0: all
};

/// Parameters, as the user gives them.
struct ParameterOptions {
  std::string config;                 ///< a YAML file
  std::vector<std::string> settings;  ///< "name=value"

  bool given() const { return !config.empty() || !settings.empty(); }
};

/// Adds the options of a sequence; the defaults are those in `input`.
void describeInput(InputOptions* input, boost::program_options::options_description* description);

/// Adds --config and --set.
void describeParameters(ParameterOptions* parameters,
                        boost::program_options::options_description* description);

/// Throws InputError if a number is out of its range, or an option is for another kind of input.
void checkInput(const InputOptions& input, const boost::program_options::variables_map& values);

/// \param bag what is read of it, if it is one, beside the topics and the interval. Throws
/// InputError if there is no such input.
std::unique_ptr<StereoSource> openInput(const InputOptions& input, BagOptions bag = {});

/// A source with the calibration and the masks that are asked for, and every Nth frame of it.
std::unique_ptr<StereoSource> filtered(std::unique_ptr<StereoSource> source,
                                       const InputOptions& input);

/// The file's parameters, or the defaults, with the settings. Throws InputError if the file is
/// missing or something in it, or a setting, is wrong.
/// \param warnings are printed on behalf of the tool, with those of the options.
Parameters readParameters(const char* tool, const ParameterOptions& options,
                          Parameters defaults = {}, std::vector<std::string> warnings = {});

}  // namespace point_line_odometry
