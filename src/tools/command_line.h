#pragma once

#include <boost/program_options.hpp>
#include <cstdio>
#include <exception>
#include <functional>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "point_line_odometry/input_error.h"
#include "tools/interruption.h"

namespace point_line_odometry {

/// What a tool returns when the user's input cannot be used.
constexpr int kExitBadInput = 2;

/// Runs a tool and turns every error into one line on stderr and exit code 2. A tool that is
/// interrupted ends by that signal, after it has taken away what is not whole.
inline int runTool(const char* name, const std::function<int()>& tool) {
  noteInterruptions();
  std::string error;
  try {
    return tool();
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

/// A switch that may have a value takes one only after '=': "--name" means true, whatever comes
/// next. \return name and value of such a switch, or two empty texts for any other argument.
inline std::pair<std::string, std::string> parseSwitch(
    const std::string& argument, const boost::program_options::options_description& options) {
  if (argument.rfind("--", 0) != 0) return {};
  const std::string name = argument.substr(2);
  const auto* option = options.find_nothrow(name, false);
  if (option == nullptr) return {};
  const auto semantic = option->semantic();
  const bool may_have_value = semantic->min_tokens() == 0 && semantic->max_tokens() == 1;
  return may_have_value ? std::make_pair(name, std::string("true")) : std::make_pair("", "");
}

/// Reads options and positional arguments. Throws boost::program_options::error for what does not
/// fit.
inline boost::program_options::variables_map parseArguments(
    int argc, const char* const* argv, const boost::program_options::options_description& options,
    const std::vector<const char*>& positional) {
  namespace po = boost::program_options;
  po::positional_options_description places;
  for (const char* name : positional) places.add(name, 1);
  const int style = po::command_line_style::unix_style & ~po::command_line_style::allow_guessing;
  po::variables_map values;
  po::store(po::command_line_parser(argc, argv)
                .options(options)
                .positional(places)
                .style(style)
                .extra_parser([&](const std::string& text) { return parseSwitch(text, options); })
                .run(),
            values);
  po::notify(values);
  return values;
}

/// Throws InputError if an option was given a number below 1.
inline void requirePositive(const std::string& option, long value,
                            const boost::program_options::variables_map& values) {
  if (values.count(option.substr(2)) == 0 || value > 0) return;
  throw InputError("option " + option + " is " + std::to_string(value) + ", but must be 1 or more");
}

}  // namespace point_line_odometry
