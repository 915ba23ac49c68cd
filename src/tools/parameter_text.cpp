#include "tools/parameter_text.h"

#include <locale>
#include <sstream>

#include "common/input_error.h"
#include "common/join.h"
#include "common/retired_parameters.h"

namespace point_line_odometry {
namespace {

[[noreturn]] void refuse(const ParameterSetter& setter, const char* expected) {
  throw InputError("parameter " + setter.name + " is set to '" + setter.text + "', but must be " +
                   expected);
}

/// False if the text is not a number, or has more than one.
template <typename Number>
bool parseNumber(const std::string& text, Number* number) {
  std::istringstream in(text);
  in.imbue(std::locale::classic());
  return (in >> *number) && in.peek() == std::istringstream::traits_type::eof();
}

template <typename Number>
std::string formatNumber(Number number) {
  std::ostringstream text;
  text.imbue(std::locale::classic());
  text << number;
  return text.str();
}

template <typename Number>
std::string formatRange(Number minimum, Number maximum) {
  return formatNumber(minimum) + " ... " + formatNumber(maximum);
}

}  // namespace

void ParameterSetter::parse(bool& value) const {
  if (text != "true" && text != "false") refuse(*this, "true or false");
  value = text == "true";
}

void ParameterSetter::parse(int& value) const {
  if (!parseNumber(text, &value)) refuse(*this, "a whole number");
}

void ParameterSetter::parse(double& value) const {
  if (!parseNumber(text, &value)) refuse(*this, "a number");
}

void ParameterSetter::parse(std::string& value) const { value = text; }

Parameters applySettings(Parameters parameters, const std::vector<std::string>& settings,
                         std::vector<std::string>* warnings) {
  for (const std::string& setting : settings) {
    const std::size_t equals = setting.find('=');
    if (equals == std::string::npos) {
      throw InputError("setting '" + setting + "' has no '=': write --set name=value");
    }
    ParameterSetter setter{setting.substr(0, equals), setting.substr(equals + 1), false};
    visitParameters(parameters, setter);
    if (!setter.found && !isRetired(setter.name, warnings)) {
      throw InputError("unknown parameter '" + setter.name +
                       "': 'offline_odometry --print-parameters' shows those there are");
    }
  }
  const std::vector<std::string> errors = checkParameters(parameters);
  if (!errors.empty()) throw InputError("parameters do not fit: " + join(errors, "; "));
  return parameters;
}

void ParameterRows::operator()(const char* name, bool value, const char* text) {
  rows.push_back({name, value ? "true" : "false", "true, false", "", text});
}

void ParameterRows::operator()(const char* name, const std::string& value, const char* text) {
  rows.push_back({name, value, "", "", text});
}

void ParameterRows::operator()(const char* name, int value, int minimum, int maximum,
                               const char* unit, const char* text) {
  rows.push_back({name, formatNumber(value), formatRange(minimum, maximum), unit, text});
}

void ParameterRows::operator()(const char* name, double value, double minimum, double maximum,
                               const char* unit, const char* text) {
  rows.push_back({name, formatNumber(value), formatRange(minimum, maximum), unit, text});
}

void ParameterRows::operator()(const char* name, const std::string& value,
                               const std::vector<std::string>& choices, const char* text) {
  rows.push_back({name, value, join(choices, ", "), "", text});
}

std::string formatMarkdownTable(const std::vector<ParameterRow>& rows) {
  std::string table = "| name | default | range | unit | meaning |\n|---|---|---|---|---|\n";
  for (const ParameterRow& row : rows) {
    table += "| `" + row.name + "` | " + row.value + " | " + row.range + " | " + row.unit + " | " +
             row.text + " |\n";
  }
  return table;
}

std::string formatParameterTable() {
  ParameterRows table;
  const Parameters defaults;
  visitParameters(defaults, table);
  return formatMarkdownTable(table.rows);
}

}  // namespace point_line_odometry
