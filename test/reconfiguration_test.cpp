/// The messages to dynamic_reconfigure's clients agree with the table of parameters.

#include "ros/reconfiguration.h"

#include <gtest/gtest.h>

#include <map>
#include <set>

#include "common/retired_parameters.h"

namespace point_line_odometry {
namespace {

using dynamic_reconfigure::Config;

/// Compares the values of messages with each entry of the table.
struct Comparison {
  const Config& minimum;
  const Config& maximum;
  const Config& standard;

  template <typename Value, typename Entries>
  static Value find(const Entries& all, const std::string& name) {
    for (const auto& entry : all)
      if (entry.name == name) return static_cast<Value>(entry.value);
    ADD_FAILURE() << name << " is missing";
    return Value();
  }

  void operator()(const char* name, bool value, const char*) {
    EXPECT_EQ(find<bool>(standard.bools, name), value) << name;
  }
  void operator()(const char* name, const std::string& value, const std::vector<std::string>&,
                  const char*) {
    EXPECT_EQ(find<std::string>(standard.strs, name), value) << name;
  }
  void operator()(const char* name, int value, int low, int high, const char*, const char*) {
    EXPECT_EQ(find<int>(standard.ints, name), value) << name;
    EXPECT_EQ(find<int>(minimum.ints, name), low) << name;
    EXPECT_EQ(find<int>(maximum.ints, name), high) << name;
  }
  void operator()(const char* name, double value, double low, double high, const char*,
                  const char*) {
    EXPECT_EQ(find<double>(standard.doubles, name), value) << name;
    EXPECT_EQ(find<double>(minimum.doubles, name), low) << name;
    EXPECT_EQ(find<double>(maximum.doubles, name), high) << name;
  }
};

TEST(Reconfiguration, DescribesTheTable) {
  const auto description = ReconfigurableParameters::__getDescriptionMessage__();
  Comparison comparison{description.min, description.max, description.dflt};
  const Parameters defaults;
  visitParameters(defaults, comparison);

  std::vector<std::string> names;
  std::map<std::string, std::string> types;
  for (const auto& group : description.groups) {
    for (const auto& parameter : group.parameters) {
      names.push_back(parameter.name);
      types[parameter.name] = parameter.type;
      EXPECT_EQ(parameter.name.rfind(group.name + "/", 0) == 0, group.name != "retired");
      EXPECT_FALSE(parameter.description.empty());
    }
  }
  std::vector<std::string> expected;
  for (const auto& parameter : parameterTexts(defaults)) expected.push_back(parameter.first);
  for (const RetiredParameter& each : kRetiredParameters) expected.emplace_back(each.name);
  EXPECT_EQ(names, expected);
  EXPECT_EQ(types["points/enabled"], "bool");
  EXPECT_EQ(types["points/levels"], "int");
  EXPECT_EQ(types["motion/huber_delta"], "double");
  EXPECT_EQ(types["motion/residual_images"], "str");
}

TEST(Reconfiguration, GroupsOfValuesAreThoseOfTheDescription) {
  const auto description = ReconfigurableParameters::__getDescriptionMessage__();
  Config values;
  ReconfigurableParameters().__toMessage__(values);
  ASSERT_EQ(values.groups.size(), description.groups.size());
  std::set<int> ids;
  for (std::size_t i = 0; i < values.groups.size(); ++i) {
    EXPECT_EQ(values.groups[i].name, description.groups[i].name);
    EXPECT_EQ(values.groups[i].id, description.groups[i].id);
    EXPECT_EQ(values.groups[i].parent, 0);
    ids.insert(values.groups[i].id);
  }
  EXPECT_EQ(ids.size(), values.groups.size());
}

TEST(Reconfiguration, MessagesContainEveryValue) {
  ReconfigurableParameters sent = ReconfigurableParameters::__getMax__();
  sent.values.motion.residual_images = "left";
  Config message;
  sent.__toMessage__(message);
  ReconfigurableParameters received;
  testing::internal::CaptureStderr();
  received.__fromMessage__(message);
  EXPECT_EQ(testing::internal::GetCapturedStderr(), "") << "nothing to warn of";
  EXPECT_TRUE(changedParameters(sent.values, received.values).empty());
  EXPECT_FALSE(changedParameters({}, received.values).empty());
}

TEST(Reconfiguration, ValuesThatAMessageLacksAreKept) {
  Config message;
  message.ints.resize(1);
  message.ints[0].name = "lines/max_count";
  message.ints[0].value = 17;
  ReconfigurableParameters parameters = ReconfigurableParameters::__getMin__();
  const Parameters before = parameters.values;
  parameters.__fromMessage__(message);
  const ParameterTexts changed = changedParameters(before, parameters.values);
  ASSERT_EQ(changed.size(), 1U);
  EXPECT_EQ(changed[0].first, "lines/max_count");
  EXPECT_EQ(changed[0].second, "17");
}

/// Clients refuse to send what is not described, and look its range up.
TEST(Reconfiguration, RetiredParametersAreTakenAndKeepTheirValue) {
  const auto description = ReconfigurableParameters::__getDescriptionMessage__();
  for (const RetiredParameter& retired : kRetiredParameters) {
    for (const Config* message : {&description.min, &description.max, &description.dflt})
      EXPECT_EQ(Comparison::find<int>(message->ints, retired.name), retired.value);
    Config wanted;
    wanted.ints.resize(1);
    wanted.ints[0].name = retired.name;
    wanted.ints[0].value = retired.value + 1;
    ReconfigurableParameters parameters;
    testing::internal::CaptureStderr();
    parameters.__fromMessage__(wanted);
    EXPECT_NE(testing::internal::GetCapturedStderr().find(retired.name), std::string::npos);
    EXPECT_TRUE(changedParameters({}, parameters.values).empty());
    Config shown;
    parameters.__toMessage__(shown);
    EXPECT_EQ(Comparison::find<int>(shown.ints, retired.name), retired.value);
  }
}

}  // namespace
}  // namespace point_line_odometry
