// The files that a run of offline_odometry leaves.
#include "tools/run_report.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <string>
#include <vector>

namespace point_line_odometry {
namespace {

struct CountCase {
  const char* name;
  int FrameCounts::*count;
};

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
  FrameCounts counts;
  counts.*count = 2;
  const auto columns = listCounts(counts);
  const auto column =
      std::find_if(columns.begin(), columns.end(),
                   [name = std::string(name)](const auto& named) { return named.first == name; });
  ASSERT_NE(column, columns.end());
  EXPECT_EQ(column->second, 2);
}

INSTANTIATE_TEST_SUITE_P(
    Counts, CountOfEvents,
    ::testing::Values(CountCase{"failed_windows", &FrameCounts::failed_windows},
                      CountCase{"relocalizations", &FrameCounts::relocalizations}),
    [](const auto& info) { return std::string(info.param.name); });

TEST(RunReport, SummaryAndTableSayWhichDetectorsRan) {
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
