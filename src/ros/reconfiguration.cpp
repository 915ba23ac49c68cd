#include "ros/reconfiguration.h"

#include <dynamic_reconfigure/config_tools.h>
#include <ros/console.h>

#include <algorithm>
#include <map>
#include <string>
#include <utility>
#include <vector>

#include "common/join.h"
#include "common/retired_parameters.h"
#include "ros/parameter_tree.h"

namespace point_line_odometry {
namespace {

using dynamic_reconfigure::Config;
using dynamic_reconfigure::ConfigTools;

std::string sectionOf(const std::string& name) { return name.substr(0, name.find('/')); }

/// Sets each number to the lower or upper end of its range.
struct RangeEnd {
  bool upper;

  void operator()(const char*, bool& value, const char*) const { value = upper; }
  void operator()(const char*, std::string&, const std::vector<std::string>&, const char*) const {}
  template <typename T>
  void operator()(const char*, T& value, T minimum, T maximum, const char*, const char*) const {
    value = upper ? maximum : minimum;
  }
};

ReconfigurableParameters rangeEnd(bool upper) {
  ReconfigurableParameters end;
  visitParameters(end.values, RangeEnd{upper});
  return end;
}

struct MessageReader {
  const Config& message;

  template <typename T, typename... Rest>
  void operator()(const char* name, T& value, const Rest&...) const {
    ConfigTools::getParameter(message, name, value);
  }
};

struct MessageWriter {
  Config* message;

  template <typename T, typename... Rest>
  void operator()(const char* name, const T& value, const Rest&...) const {
    ConfigTools::appendParameter(*message, name, value);
  }
};

/// Collects a struct for each section: one call of the parameter server for all of its values.
struct TreeWriter {
  std::map<std::string, XmlRpc::XmlRpcValue> sections;

  template <typename T, typename... Rest>
  void operator()(const char* name, const T& value, const Rest&...) {
    const std::string section = sectionOf(name);
    sections[section][std::string(name).substr(section.size() + 1)] = value;
  }
};

/// A group for each section, in the order of the table, under the group of all.
struct Describer {
  std::vector<dynamic_reconfigure::Group> groups;

  Describer() : groups(1) { groups[0].name = "Default"; }

  void operator()(const char* name, bool, const char* text) { add(name, "bool", text); }
  void operator()(const char* name, const std::string&, const std::vector<std::string>& choices,
                  const char* text) {
    add(name, "str", text, choice(choices));
  }
  void operator()(const char* name, int, int, int, const char* unit, const char* text) {
    add(name, "int", withUnit(text, unit));
  }
  void operator()(const char* name, double, double, double, const char* unit, const char* text) {
    add(name, "double", withUnit(text, unit));
  }

  /// For clients that refuse to send what is not described.
  void addRetired() {
    for (const RetiredParameter& each : kRetiredParameters) {
      const std::string text = std::string("ignored since version ") + each.since;
      add(each.name, "int", text, "", "retired");
    }
  }

 private:
  static std::string withUnit(const char* text, const char* unit) {
    return *unit == '\0' ? text : std::string(text) + " [" + unit + "]";
  }

  /// As Python source, which the clients evaluate.
  static std::string choice(const std::vector<std::string>& choices) {
    std::vector<std::string> entries;
    for (const std::string& value : choices) {
      entries.push_back("{'name': '" + value + "', 'value': '" + value +
                        "', 'type': 'str', 'ctype': 'std::string', 'description': ''}");
    }
    return "{'enum_description': '', 'enum': [" + join(entries, ", ") + "]}";
  }

  void add(const std::string& name, const char* type, const std::string& text,
           const std::string& edit_method = "") {
    add(name, type, text, edit_method, sectionOf(name));
  }
  void add(const std::string& name, const char* type, const std::string& text,
           const std::string& edit_method, const std::string& group) {
    if (groups.back().name != group) {
      groups.emplace_back();
      groups.back().name = group;
      groups.back().id = static_cast<std::int32_t>(groups.size()) - 1;
    }
    dynamic_reconfigure::ParamDescription description;
    description.name = name;
    description.type = type;
    description.level = 1;
    description.description = text;
    description.edit_method = edit_method;
    groups.back().parameters.push_back(description);
  }
};

Describer describe() {
  Describer describer;
  const Parameters defaults;
  visitParameters(defaults, describer);
  describer.addRetired();
  return describer;
}

/// A warning for each retired parameter that a client wants to change. Those that send all values
/// back send these, too.
std::vector<std::string> retiredIn(const Config& message) {
  std::vector<std::string> warnings;
  for (const RetiredParameter& retired : kRetiredParameters) {
    int wanted = retired.value;
    ConfigTools::getParameter(message, retired.name, wanted);
    if (wanted != retired.value) isRetired(retired.name, &warnings);
  }
  return warnings;
}

}  // namespace

void ReconfigurableParameters::__fromServer__(const ros::NodeHandle& private_nh) {
  ParameterTree tree(readPrivateParameters(private_nh));
  visitParameters(values, tree);
}

void ReconfigurableParameters::__toServer__(const ros::NodeHandle& private_nh) const {
  TreeWriter writer;
  visitParameters(values, writer);
  for (const auto& [section, tree] : writer.sections) private_nh.setParam(section, tree);
}

void ReconfigurableParameters::__fromMessage__(const Config& message) {
  visitParameters(values, MessageReader{message});
  for (const std::string& warning : retiredIn(message)) ROS_WARN("%s", warning.c_str());
}

void ReconfigurableParameters::__toMessage__(Config& message) const {
  message = Config();
  visitParameters(values, MessageWriter{&message});
  for (const RetiredParameter& each : kRetiredParameters)
    ConfigTools::appendParameter(message, each.name, each.value);
  for (const dynamic_reconfigure::Group& group : describe().groups) {
    dynamic_reconfigure::GroupState state;
    state.name = group.name;
    state.state = true;
    state.id = group.id;
    message.groups.push_back(state);
  }
}

ReconfigurableParameters ReconfigurableParameters::__getMin__() { return rangeEnd(false); }
ReconfigurableParameters ReconfigurableParameters::__getMax__() { return rangeEnd(true); }

dynamic_reconfigure::ConfigDescription ReconfigurableParameters::__getDescriptionMessage__() {
  dynamic_reconfigure::ConfigDescription description;
  description.groups = describe().groups;
  __getMin__().__toMessage__(description.min);
  __getMax__().__toMessage__(description.max);
  __getDefault__().__toMessage__(description.dflt);
  return description;
}

Reconfiguration::Reconfiguration(const ros::NodeHandle& private_nh, const Parameters& in_force,
                                 std::function<void(const Parameters&)> apply)
    : in_force_(in_force), apply_(std::move(apply)), server_(mutex_, private_nh) {
  server_.setCallback([this](ReconfigurableParameters& wanted, std::uint32_t) { take(&wanted); });
}

void Reconfiguration::take(ReconfigurableParameters* wanted) {
  const ParameterTexts changed = changedParameters(in_force_, wanted->values);
  const std::vector<std::string> errors = checkParameters(wanted->values);
  if (!errors.empty()) {
    wanted->values = in_force_;
    ROS_WARN("parameters are not changed: %s", join(errors, "; ").c_str());
    return;
  }
  if (changed.empty()) return;
  in_force_ = wanted->values;
  std::vector<std::string> words;
  for (const auto& [name, value] : changed) words.push_back(name + ": " + value);
  ROS_INFO("from the next frame on %s", join(words, ", ").c_str());
  apply_(in_force_);
}

}  // namespace point_line_odometry
