// The files that a run of offline_odometry leaves.
#include "tools/run_report.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <nlohmann/json.hpp>
#include <sstream>
#include <string>
#include <vector>

namespace point_line_odometry {
namespace {

struct CountCase {
  const char* name;
  int FrameCounts::*count;
};

std::vector<std::string> split(const std::string& line) {
  std::vector<std::string> cells;
  std::istringstream in(line);
  for (std::string cell; std::getline(in, cell, ',');) cells.push_back(cell);
  return cells;
}

class CountOfEvents : public ::testing::TestWithParam<CountCase> {};

TEST_P(CountOfEvents, IsSummedUpInTheSummary) {
  const auto [name, count] = GetParam();
  const std::string label = std::string("\"") + name + "\": ";
  const auto contains = [](const std::string& text, const std::string& words) {
    return text.find(words) != std::string::npos;
  };
  EXPECT_TRUE(contains(formatSummaryJson({}, {}), label + "0,"));
  std::vector<FrameRow> rows(4);
  rows[1].counts.*count = 1;
  rows[3].counts.*count = 2;
  const std::string summary = formatSummaryJson(rows, {});
  EXPECT_TRUE(contains(summary, label + "3,")) << summary;
}

TEST_P(CountOfEvents, IsAColumnOfTheFrames) {
  const auto [name, count] = GetParam();
  FrameRow row;
  row.counts.*count = 2;
  const std::string csv = formatFramesCsv({row});
  const std::size_t end = csv.find('\n');
  const std::vector<std::string> names = split(csv.substr(0, end));
  const std::vector<std::string> values = split(csv.substr(end + 1));
  const auto column = std::find(names.begin(), names.end(), name);
  ASSERT_NE(column, names.end()) << csv;
  EXPECT_EQ(values.at(static_cast<std::size_t>(column - names.begin())), "2") << csv;
}

INSTANTIATE_TEST_SUITE_P(
    Counts, CountOfEvents,
    ::testing::Values(CountCase{"failed_windows", &FrameCounts::failed_windows},
                      CountCase{"relocalizations", &FrameCounts::relocalizations}),
    [](const auto& info) { return std::string(info.param.name); });

TEST(RunReport, SummaryIsJsonWhateverTheNames) {
  RunInfo info;
  info.input = "bags/\"quoted\"\n\xff.bag";
  const auto summary = nlohmann::json::parse(formatSummaryJson(std::vector<FrameRow>(3), info));
  EXPECT_EQ(summary["input"], "bags/\"quoted\"\n\xef\xbf\xbd.bag");
  EXPECT_EQ(summary["frames"], 3);
  EXPECT_EQ(summary["states"], nlohmann::json({{"initializing", 3}}));
  EXPECT_EQ(summary["weighted_residuals"]["points"]["size"], 0);
  EXPECT_EQ(summary.count("recording"), 0U);
}

TEST(RunReport, TimesAreSummedUpByMeanAndQuantiles) {
  std::vector<FrameRow> rows(20);
  for (std::size_t i = 0; i < rows.size(); ++i) rows[i].decode_ms = static_cast<double>(20 - i);
  const auto summary = nlohmann::json::parse(formatSummaryJson(rows, {}));
  const nlohmann::json expected = {{"mean", 10.5}, {"median", 11.0}, {"p95", 20.0}, {"max", 20.0}};
  EXPECT_EQ(summary["times"]["decode_ms"], expected);
}

TEST(RunReport, SummaryAndTableNameTheDetectors) {
  RunInfo info;
  info.line_detector = "lsd";
  info.point_descriptor = "orb";
  const std::string summary = formatSummaryJson({}, info);
  EXPECT_NE(summary.find("\"line_detector\": \"lsd\","), std::string::npos) << summary;
  EXPECT_NE(summary.find("\"point_descriptor\": \"orb\","), std::string::npos) << summary;
  const std::string table = formatTable({}, info);
  EXPECT_NE(table.find("line detector: lsd; point descriptor: orb\n"), std::string::npos) << table;
}

}  // namespace
}  // namespace point_line_odometry
