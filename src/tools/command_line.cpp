#include "tools/command_line.h"

#include <algorithm>
#include <boost/program_options.hpp>
#include <cstdio>
#include <exception>
#include <new>
#include <utility>

#include "common/input_error.h"
#include "common/recording_format.h"
#include "point_line_odometry/version.h"
#include "tools/interruption.h"

namespace point_line_odometry {
namespace {

/// Name and value of a switch that may have a value, or two empty strings for any other argument.
std::pair<std::string, std::string> parseSwitch(
    const std::string& argument, const boost::program_options::options_description& options) {
  if (argument.rfind("--", 0) != 0) return {};
  const std::string name = argument.substr(2);
  const auto* option = options.find_nothrow(name, false);
  if (option == nullptr) return {};
  const auto semantic = option->semantic();
  const bool may_have_value = semantic->min_tokens() == 0 && semantic->max_tokens() == 1;
  return may_have_value ? std::make_pair(name, std::string("true")) : std::make_pair("", "");
}

/// "1", or "1 to 3".
std::string knownFormats() {
  const std::string last = std::to_string(kRecordingFormat);
  return kRecordingFormat == 1 ? last : "1 to " + last;
}

}  // namespace

int runTool(const char* name, int argc, char** argv, const std::function<int(int, char**)>& tool) {
  if (std::find(argv + 1, argv + argc, std::string("--version")) != argv + argc) {
    std::printf(
        "%s (point_line_odometry) %s\nreads bags of version 1.2 and 2.0, recordings of format %s\n",
        name, version(), knownFormats().c_str());
    return 0;
  }
  noteInterruptions();
  std::string error;
  try {
    return tool(argc, argv);
  } catch (const Interrupted&) {
    std::fprintf(stderr, "%s: interrupted, nothing is written\n", name);
    endByInterruption();
    return kExitBadInput;
  } catch (const boost::program_options::error& caught) {
    error = std::string(caught.what()) + "; see --help";
  } catch (const std::bad_alloc&) {
    error = "out of memory: free some, or take a smaller input";
  } catch (const std::exception& caught) {
    error = caught.what();
  }
  for (char& c : error) c = c == '\n' ? ' ' : c;
  std::fprintf(stderr, "%s: %s\n", name, error.c_str());
  return kExitBadInput;
}

boost::program_options::variables_map parseArguments(
    int argc, const char* const* argv, const boost::program_options::options_description& options,
    const std::vector<const char*>& positional) {
  namespace po = boost::program_options;
  po::positional_options_description positions;
  for (const char* name : positional) positions.add(name, 1);
  const int style = po::command_line_style::unix_style & ~po::command_line_style::allow_guessing;
  po::variables_map values;
  po::store(po::command_line_parser(argc, argv)
                .options(options)
                .positional(positions)
                .style(style)
                .extra_parser([&](const std::string& text) { return parseSwitch(text, options); })
                .run(),
            values);
  po::notify(values);
  return values;
}

void printWarnings(const char* tool, const std::vector<std::string>& warnings) {
  for (const std::string& warning : warnings)
    std::fprintf(stderr, "%s: warning: %s\n", tool, warning.c_str());
}

void refuseOptions(const boost::program_options::variables_map& values,
                   const std::vector<const char*>& names, const std::string& what_for) {
  for (const char* name : names) {
    if (values.count(name) == 0 || values[name].defaulted()) continue;
    throw InputError("option --" + std::string(name) + " is for " + what_for);
  }
}

void requirePositive(const std::string& option, long value,
                     const boost::program_options::variables_map& values) {
  if (values.count(option.substr(2)) == 0 || value > 0) return;
  throw InputError("option " + option + " is " + std::to_string(value) + ", but must be 1 or more");
}

}  // namespace point_line_odometry
