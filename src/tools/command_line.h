#pragma once

#include <boost/program_options/options_description.hpp>
#include <boost/program_options/value_semantic.hpp>
#include <boost/program_options/variables_map.hpp>
#include <functional>
#include <string>
#include <vector>

namespace point_line_odometry {

/// What a tool returns when the user's input cannot be used.
constexpr int kExitBadInput = 2;

/// Runs a tool and turns every error into one line on stderr and exit code 2. A tool that is
/// interrupted removes incomplete files and ends by that signal. With --version it prints the
/// version and the formats that are read, and does not run.
int runTool(const char* name, int argc, char** argv, const std::function<int(int, char**)>& tool);

/// Reads options and positional arguments. A switch that may have a value takes one only after '=':
/// "--name" means true, whatever comes next. Throws boost::program_options::error for
/// invalid arguments.
boost::program_options::variables_map parseArguments(
    int argc, const char* const* argv, const boost::program_options::options_description& options,
    const std::vector<const char*>& positional);

/// Writes a line for each to stderr.
void printWarnings(const char* tool, const std::vector<std::string>& warnings);

/// Throws InputError if one of these options was given, that is for something else.
void refuseOptions(const boost::program_options::variables_map& values,
                   const std::vector<const char*>& names, const std::string& what_for);

/// Throws InputError if an option was given a number below 1.
void requirePositive(const std::string& option, long value,
                     const boost::program_options::variables_map& values);

}  // namespace point_line_odometry
