#pragma once

#include <string>
#include <vector>

#include "point_line_odometry/parameters.h"

namespace point_line_odometry {

/// Visitor of a parameter table that sets the parameter of one name from text; `found` is
/// true if there is one. Throws InputError if the text is not a valid value.
struct ParameterSetter {
  std::string name;
  std::string text;
  bool found = false;

  template <typename T, typename... Rest>
  void operator()(const char* candidate, T& value, const Rest&...) {
    if (name != candidate) return;
    found = true;
    parse(value);
  }

 private:
  void parse(bool& value) const;
  void parse(int& value) const;
  void parse(double& value) const;
  void parse(std::string& value) const;
};

/// Applies settings "name=value". Throws InputError for unknown names and invalid values.
/// \param warnings gets a sentence for each retired parameter that is named.
Parameters applySettings(Parameters parameters, const std::vector<std::string>& settings,
                         std::vector<std::string>* warnings);

/// A parameter as text.
struct ParameterRow {
  std::string name;
  std::string value;
  std::string range;
  std::string unit;
  std::string text;
};

/// Visitor of a parameter table that collects each parameter as text.
struct ParameterRows {
  std::vector<ParameterRow> rows;

  void operator()(const char* name, bool value, const char* text);
  void operator()(const char* name, const std::string& value, const char* text);
  void operator()(const char* name, int value, int minimum, int maximum, const char* unit,
                  const char* text);
  void operator()(const char* name, double value, double minimum, double maximum, const char* unit,
                  const char* text);
  void operator()(const char* name, const std::string& value,
                  const std::vector<std::string>& choices, const char* text);
};

/// A table in Markdown.
std::string formatMarkdownTable(const std::vector<ParameterRow>& rows);

/// The core's parameters with their defaults as a table in Markdown.
std::string formatParameterTable();

}  // namespace point_line_odometry
