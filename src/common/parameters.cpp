#include "point_line_odometry/parameters.h"

#include <yaml-cpp/yaml.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <opencv2/core/version.hpp>
#include <set>
#include <sstream>
#include <stdexcept>

#include "common/classic_stream.h"
#include "common/join.h"
#include "common/opencv_lsd.h"
#include "common/parameter_checker.h"
#include "common/retired_parameters.h"

namespace point_line_odometry {
namespace {

/// Deeper than all names; a map that contains itself, which YAML can express, has no end.
constexpr int kMaxMapDepth = 3;

/// Collects "a/b/c" -> node for the leaves of nested maps. Throws YAML::Exception if a name is no
/// text or maps are nested too deeply.
void flatten(const YAML::Node& node, int depth, const std::string& prefix,
             std::vector<std::pair<std::string, YAML::Node>>* leaves) {
  if (depth > kMaxMapDepth) throw YAML::Exception(node.Mark(), "maps are nested too deeply");
  for (const auto& entry : node) {
    const std::string name = prefix + entry.first.as<std::string>();
    if (entry.second.IsMap()) {
      flatten(entry.second, depth + 1, name + "/", leaves);
    } else {
      leaves->emplace_back(name, entry.second);
    }
  }
}

/// Sets the parameters that the file names, and collects the known names and the values of the
/// wrong type.
struct YamlReader {
  const std::vector<std::pair<std::string, YAML::Node>>& leaves;
  std::set<std::string> known;
  std::vector<std::string> errors;

  template <typename T, typename... Rest>
  void operator()(const char* name, T& value, const Rest&...) {
    known.insert(name);
    for (const auto& leaf : leaves) {
      if (leaf.first != name) continue;
      try {
        value = leaf.second.as<T>();
      } catch (const YAML::Exception&) {
        errors.push_back(leaf.first + " has a value of the wrong type");
      }
    }
  }
};

/// Formats every value as text.
struct TextCollector {
  ParameterTexts texts;

  template <typename T, typename... Rest>
  void operator()(const char* name, const T& value, const Rest&...) {
    std::ostringstream text = classicStream();
    text.precision(std::numeric_limits<double>::max_digits10);
    text << std::boolalpha << value;
    texts.emplace_back(name, text.str());
  }
};

}  // namespace

const char* toString(LineDetectorKind kind) {
  switch (kind) {
    case LineDetectorKind::kNone:
      return "none";
    case LineDetectorKind::kEdgeChains:
      return "edge_chains";
    case LineDetectorKind::kLsd:
      return "lsd";
  }
  return "unknown";
}

ParameterTexts parameterTexts(const Parameters& parameters) {
  TextCollector collector;
  visitParameters(parameters, collector);
  return std::move(collector.texts);
}

ParameterTexts changedParameters(const Parameters& before, const Parameters& after) {
  const ParameterTexts old = parameterTexts(before);
  ParameterTexts changed;
  std::size_t i = 0;
  for (auto& [name, value] : parameterTexts(after)) {
    if (value != old[i++].second) changed.emplace_back(name, value);
  }
  return changed;
}

bool isChanged(const Parameters& before, const Parameters& after, const std::string& prefix) {
  const ParameterTexts changed = changedParameters(before, after);
  return std::any_of(changed.begin(), changed.end(), [&](const auto& parameter) {
    return parameter.first.compare(0, prefix.size(), prefix) == 0;
  });
}

std::vector<std::string> checkParameters(const Parameters& parameters) {
  ParameterChecker checker;
  visitParameters(parameters, checker);
  if (!parameters.points.enabled && !parameters.lines.enabled) {
    checker.errors.emplace_back(
        "points/enabled and lines/enabled are both false: nothing is left to track");
  }
  if (parameters.lines.detector == "lsd" && createLsd().empty()) {
    checker.errors.emplace_back(
        "lines/detector is 'lsd', but this OpenCV (" CV_VERSION
        ") has no line segment detector: take edge_chains, lsd_or_edge_chains, or OpenCV 4.5.4");
  }
  return std::move(checker.errors);
}

const Parameters& validated(const Parameters& parameters) {
  const std::vector<std::string> errors = checkParameters(parameters);
  if (!errors.empty()) throw std::invalid_argument("parameters: " + join(errors, "; "));
  return parameters;
}

Parameters loadParameters(const std::string& yaml_file, const std::vector<std::string>& ignored,
                          std::vector<std::string>* warnings) {
  YAML::Node root;
  std::vector<std::pair<std::string, YAML::Node>> leaves;
  try {
    root = YAML::LoadFile(yaml_file);
    if (root.IsMap()) flatten(root, 1, "", &leaves);
  } catch (const YAML::Exception& error) {
    throw std::runtime_error("parameter file '" + yaml_file + "' cannot be read: " + error.what());
  }
  if (!root.IsMap() && !root.IsNull()) {
    throw std::runtime_error("parameter file '" + yaml_file + "' is no map of names");
  }

  Parameters parameters;
  YamlReader reader{leaves, {}, {}};
  visitParameters(parameters, reader);
  for (const auto& leaf : leaves) {
    const bool legal = reader.known.count(leaf.first) > 0 ||
                       std::find(ignored.begin(), ignored.end(), leaf.first) != ignored.end() ||
                       isRetired(leaf.first, warnings);
    if (!legal) reader.errors.push_back("unknown parameter " + leaf.first);
  }
  const std::vector<std::string> out_of_range = checkParameters(parameters);
  reader.errors.insert(reader.errors.end(), out_of_range.begin(), out_of_range.end());
  if (!reader.errors.empty()) {
    throw std::runtime_error("parameter file '" + yaml_file + "': " + join(reader.errors, "; "));
  }
  return parameters;
}

}  // namespace point_line_odometry
