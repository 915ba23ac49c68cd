// The files that a run of offline_odometry leaves.
#include "tools/run_report.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <string>
#include <vector>

namespace point_line_odometry {
namespace {

std::vector<FrameRow> rowsWithFailedWindows(const std::vector<int>& failed) {
  std::vector<FrameRow> rows(failed.size());
  for (std::size_t i = 0; i < failed.size(); ++i) rows[i].counts.failed_windows = failed[i];
  return rows;
}

TEST(RunReport, SummaryHasTheSumOfTheFailedWindows) {
  const auto contains = [](const std::string& text, const std::string& words) {
    return text.find(words) != std::string::npos;
  };
  EXPECT_TRUE(contains(formatSummaryJson({}, {}), "\"failed_windows\": 0,"));
  const std::string summary = formatSummaryJson(rowsWithFailedWindows({0, 1, 0, 2}), {});
  EXPECT_TRUE(contains(summary, "\"failed_windows\": 3,")) << summary;
}

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

TEST(RunReport, FailedWindowsAreAColumnOfTheFrames) {
  FrameCounts counts;
  counts.failed_windows = 2;
  const auto columns = listCounts(counts);
  const auto column = std::find_if(columns.begin(), columns.end(), [](const auto& named) {
    return std::string(named.first) == "failed_windows";
  });
  ASSERT_NE(column, columns.end());
  EXPECT_EQ(column->second, 2);
}

}  // namespace
}  // namespace point_line_odometry
