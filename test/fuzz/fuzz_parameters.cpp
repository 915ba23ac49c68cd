/// Parameters: files, settings of the command line, the parameter server.

#include <sstream>
#include <string>
#include <vector>

#include "common/input_error.h"
#include "fuzz/fuzz_support.h"
#include "fuzz/fuzz_targets.h"
#include "ros/parameter_loader.h"
#include "tools/parameter_text.h"

namespace point_line_odometry {
namespace {

using XmlRpc::XmlRpcValue;

std::vector<std::string> linesOf(const std::string& text) {
  std::vector<std::string> lines;
  std::istringstream in(text);
  for (std::string line; std::getline(in, line);) lines.push_back(line);
  return lines;
}

XmlRpcValue makeValue(char type, const std::string& text) {
  switch (type) {
    case 'b':
      return XmlRpcValue(text == "true");
    case 'i':
      return XmlRpcValue(std::atoi(text.c_str()));
    case 'd':
      return XmlRpcValue(std::atof(text.c_str()));
    case 'a': {
      XmlRpcValue array;
      array[0] = text;
      return array;
    }
    case 't': {
      XmlRpcValue tree;
      tree["value"] = true;
      return tree;
    }
    default:
      return XmlRpcValue(text);
  }
}

/// Sets a value at its path, unless a leaf is in the path.
void insert(const std::string& path, const XmlRpcValue& value, XmlRpcValue* tree) {
  const std::size_t slash = path.find('/');
  XmlRpcValue& child = (*tree)[path.substr(0, slash)];
  if (slash == std::string::npos) {
    child = value;
  } else if (!child.valid() || child.getType() == XmlRpcValue::TypeStruct) {
    insert(path.substr(slash + 1), value, &child);
  }
}

void requireAllowed(const Parameters& parameters) {
  require(checkParameters(parameters).empty(), "accepted parameters are in their ranges");
}

}  // namespace

void fuzzConfiguration(const std::uint8_t* data, std::size_t size) {
  static const ScratchFolder folder;
  const std::string text = toText(data, size);
  const std::string file = folder.file("parameters.yaml").string();
  folder.write("parameters.yaml", text);
  try {
    requireAllowed(loadParameters(file));
  } catch (const std::runtime_error& error) {
    const bool named = std::string(error.what()).find(file) != std::string::npos;
    require(named, std::string("the file at fault is named, not only: ") + error.what());
  }
  try {
    std::vector<std::string> warnings;
    requireAllowed(applySettings({}, linesOf(text), &warnings));
  } catch (const InputError&) {
    return;
  }
}

void fuzzRosParameters(const std::uint8_t* data, std::size_t size) {
  XmlRpcValue tree;
  for (const std::string& line : linesOf(toText(data, size))) {
    const std::size_t equals = line.find('=');
    if (line.size() < 3 || equals == std::string::npos || equals < 2) continue;
    insert(line.substr(2, equals - 2), makeValue(line[0], line.substr(equals + 1)), &tree);
  }
  try {
    const AllParameters parameters = parseParameters(tree);
    requireAllowed(parameters.core);
    require(checkNodeParameters(parameters.node).empty(), "node parameters are in their ranges");
    require(initialPose(parameters.node).matrix().allFinite(), "initial_pose is finite");
  } catch (const std::runtime_error&) {
    return;
  }
}

}  // namespace point_line_odometry
