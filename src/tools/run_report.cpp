#include "tools/run_report.h"

#include <sys/resource.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <filesystem>
#include <fstream>
#include <iomanip>
#include <map>
#include <nlohmann/json.hpp>
#include <numeric>
#include <sstream>
#include <utility>

#include "common/classic_stream.h"
#include "common/statistics.h"
#include "point_line_odometry/version.h"

namespace point_line_odometry {
namespace {

using nlohmann::json;

/// Mean and quantiles of a series.
struct Statistics {
  double mean = 0.0;
  double median = 0.0;
  double p95 = 0.0;
  double max = 0.0;
};

/// A named series, e.g. the times of a stage [ms], one per frame.
using Series = std::pair<std::string, std::vector<double>>;

/// All zero for an empty series.
Statistics computeStatistics(const std::vector<double>& values) {
  if (values.empty()) return {};
  const double sum = std::accumulate(values.begin(), values.end(), 0.0);
  return {sum / static_cast<double>(values.size()), median(values), quantile(values, 0.95),
          *std::max_element(values.begin(), values.end())};
}

/// Names and values of FrameCounts, as in the columns of frames.csv.
std::vector<std::pair<const char*, int>> listCounts(const FrameCounts& c) {
  return {{"points_left", c.points_left},
          {"points_right", c.points_right},
          {"lines_left", c.lines_left},
          {"lines_right", c.lines_right},
          {"point_stereo_matches", c.point_stereo_matches},
          {"line_stereo_matches", c.line_stereo_matches},
          {"point_matches", c.point_matches},
          {"line_matches", c.line_matches},
          {"lines_not_triangulable", c.lines_not_triangulable},
          {"point_inliers", c.point_inliers},
          {"line_inliers", c.line_inliers},
          {"iterations", c.iterations},
          {"map_points", c.map_points},
          {"map_lines", c.map_lines},
          {"map_point_inliers", c.map_point_inliers},
          {"map_line_inliers", c.map_line_inliers},
          {"keyframes", c.keyframes},
          {"failed_windows", c.failed_windows},
          {"relocalizations", c.relocalizations}};
}

/// Names and values of the times of a frame [ms]: the stages, their total, decoding, rectification.
std::vector<std::pair<std::string, double>> listTimes(const FrameRow& row) {
  std::vector<std::pair<std::string, double>> times;
  for (int i = 0; i < kNumStages; ++i) {
    const auto stage = static_cast<Stage>(i);
    times.emplace_back(toString(stage), row.times[stage]);
  }
  times.emplace_back("total", row.times.total_ms);
  times.emplace_back("decode", row.decode_ms);
  times.emplace_back("rectify", row.rectify_ms);
  return times;
}

std::vector<Series> collectTimes(const std::vector<FrameRow>& rows) {
  std::vector<Series> series;
  for (const auto& time : listTimes(FrameRow()))
    series.emplace_back(time.first, std::vector<double>());
  for (const FrameRow& row : rows) {
    const auto times = listTimes(row);
    for (std::size_t i = 0; i < times.size(); ++i) series[i].second.push_back(times[i].second);
  }
  return series;
}

std::vector<Series> collectCounts(const std::vector<FrameRow>& rows) {
  std::vector<Series> series;
  for (const auto& count : listCounts({})) series.emplace_back(count.first, std::vector<double>());
  for (const FrameRow& row : rows) {
    const auto counts = listCounts(row.counts);
    for (std::size_t i = 0; i < counts.size(); ++i) series[i].second.push_back(counts[i].second);
  }
  return series;
}

/// Peak resident memory of the process [MB].
double peakMemory_MB() {
  rusage usage{};
  getrusage(RUSAGE_SELF, &usage);
  return static_cast<double>(usage.ru_maxrss) / 1024.0;
}

/// Formats in the classic locale with fixed decimals.
std::ostringstream fixedStream(int decimals) {
  std::ostringstream text = classicStream();
  text << std::fixed << std::setprecision(decimals);
  return text;
}

std::size_t countState(const std::vector<FrameRow>& rows, TrackingState state) {
  return static_cast<std::size_t>(std::count_if(
      rows.begin(), rows.end(), [state](const FrameRow& row) { return row.state == state; }));
}

/// Sum of a count over all frames.
int sumOf(int FrameCounts::*count, const std::vector<FrameRow>& rows) {
  return std::accumulate(rows.begin(), rows.end(), 0,
                         [count](int sum, const FrameRow& row) { return sum + row.counts.*count; });
}

/// Rounded to `decimals` decimals.
double rounded(double value, int decimals) {
  const double unit = std::pow(10.0, decimals);
  return std::round(value * unit) / unit;
}

json statisticsJson(const std::vector<Series>& all, const std::string& suffix) {
  json object = json::object();
  for (const Series& series : all) {
    const Statistics s = computeStatistics(series.second);
    object[series.first + suffix] = {{"mean", rounded(s.mean, 4)},
                                     {"median", rounded(s.median, 4)},
                                     {"p95", rounded(s.p95, 4)},
                                     {"max", rounded(s.max, 4)}};
  }
  return object;
}

json residualsJson(const ResidualHistogram& residuals) {
  return {{"size", residuals.size()},
          {"variance", rounded(residuals.variance(), 4)},
          {"counts", residuals.counts}};
}

/// Differences between a replay and its recording.
json recordingJson(const RecordingComparison& recording) {
  return {{"frames", recording.frames},
          {"equal_frames", recording.equal},
          {"max_distance_m", recording.max_distance_m},
          {"max_angle_deg", recording.max_angle_rad * 180.0 / M_PI}};
}

/// Number of rows with each text.
template <typename TextOf>
json histogramJson(const std::vector<FrameRow>& rows, const TextOf& text_of) {
  std::map<std::string, std::size_t> histogram;
  for (const FrameRow& row : rows) ++histogram[text_of(row)];
  return histogram;
}

json gyroscopeJson(const GyroscopeCalibration& gyroscope) {
  const auto list = [](const Eigen::Vector3d& v) { return json{v.x(), v.y(), v.z()}; };
  return {{"bias_rad_s", list(gyroscope.bias)},
          {"bias_sigma_rad_s", list(gyroscope.bias_sigma)},
          {"time_offset_s", gyroscope.time_offset_s},
          {"time_offset_sigma_s", gyroscope.time_offset_sigma_s}};
}

json gravityJson(const GravityCalibration& gravity) {
  const auto list = [](const Eigen::Vector3d& v) { return json{v.x(), v.y(), v.z()}; };
  return {{"known", gravity.known},
          {"up_odom", list(gravity.up)},
          {"accelerometer_bias_m_s2", list(gravity.bias)},
          {"accelerometer_bias_sigma_m_s2", list(gravity.bias_sigma)},
          {"windows",
           {{"used", gravity.windows.used},
            {"not_gravity", gravity.windows.not_gravity},
            {"rejected", gravity.windows.rejected},
            {"restarts", gravity.windows.restarts}}}};
}

/// Name and value of every parameter, both as texts for --set.
json parametersJson(const Parameters& parameters) {
  json object = json::object();
  for (const auto& [name, value] : parameterTexts(parameters)) object[name] = value;
  return object;
}

/// Name and value of each parameter that is not at its default.
json changedParametersJson(const Parameters& parameters) {
  json object = json::object();
  for (const auto& [name, value] : changedParameters(Parameters(), parameters))
    object[name] = value;
  return object;
}

std::string stampText(std::int64_t stamp_ns) {
  std::ostringstream text = classicStream();
  writeStamp(text, stamp_ns);
  return text.str();
}

/// Stamps are texts, since numbers lose nanoseconds.
json priorFileJson(const PriorFileUse& use) {
  json unmatched = json::array();
  for (const StampPair& row : use.unmatched)
    unmatched.push_back({stampText(row.from_ns), stampText(row.to_ns)});
  return {{"rows", use.rows}, {"unmatched", unmatched}};
}

json refusedJson(const RunInfo& info) {
  json refused = json::object();
  for (const auto& [reason, count] : info.refused) refused[toString(reason)] = count;
  return refused;
}

}  // namespace

std::string formatFramesCsv(const std::vector<FrameRow>& rows) {
  std::ostringstream text = fixedStream(4);
  text << "stamp_s,state,reason";
  for (const auto& count : listCounts({})) text << ',' << count.first;
  text << ",prior,prior_chi_square,prior_axes,rms_px,feature_budget";
  for (const auto& time : listTimes(FrameRow())) text << ',' << time.first << "_ms";
  text << '\n';
  for (const FrameRow& row : rows) {
    writeStamp(text, row.pose.stamp_ns);
    text << ',' << toString(row.state) << ',' << toString(row.reason);
    for (const auto& count : listCounts(row.counts)) text << ',' << count.second;
    text << ',' << toString(row.prior.use) << ',' << row.prior.chi_square << ',' << row.prior.axes;
    text << ',' << row.rms_px << ',' << row.feature_budget;
    for (const auto& time : listTimes(row)) text << ',' << time.second;
    text << '\n';
  }
  return text.str();
}

std::string formatUncertaintyCsv(const std::vector<FrameRow>& rows) {
  std::ostringstream text = classicStream();
  text << std::setprecision(9) << "stamp_s,state,twist_over_s";
  for (int i = 0; i < 6; ++i) text << ",twist_" << i;
  for (const char* name : {"twist", "pose"}) {
    for (int i = 0; i < 6; ++i) {
      for (int j = i; j < 6; ++j) text << ',' << name << "_covariance_" << i << j;
    }
  }
  text << '\n';
  for (const FrameRow& row : rows) {
    const FrameUncertainty& u = row.uncertainty;
    writeStamp(text, row.pose.stamp_ns);
    text << ',' << toString(row.state) << ',' << u.twist_over_s;
    for (int i = 0; i < 6; ++i) text << ',' << u.twist[i];
    for (const Matrix6d* covariance : {&u.twist_covariance, &u.pose_covariance}) {
      for (int i = 0; i < 6; ++i) {
        for (int j = i; j < 6; ++j) text << ',' << (*covariance)(i, j);
      }
    }
    text << '\n';
  }
  return text.str();
}

std::string formatSummaryJson(const std::vector<FrameRow>& rows, const RunInfo& info) {
  json summary = {
      {"version", version()},
      {"input", info.input},
      {"line_detector", info.line_detector},
      {"point_descriptor", info.point_descriptor},
      {"files", info.files},
      {"warnings", info.warnings},
      {"frames", rows.size()},
      {"refused_frames", refusedJson(info)},
      {"degraded", countState(rows, TrackingState::kDegraded)},
      {"lost", countState(rows, TrackingState::kLost)},
      {"failed_windows", sumOf(&FrameCounts::failed_windows, rows)},
      {"relocalizations", sumOf(&FrameCounts::relocalizations, rows)},
      {"states", histogramJson(rows, [](const FrameRow& row) { return toString(row.state); })},
      {"reasons", histogramJson(rows, [](const FrameRow& row) { return toString(row.reason); })},
      {"priors", histogramJson(rows, [](const FrameRow& row) { return toString(row.prior.use); })},
      {"unpaired_images", info.unsynchronized_images},
      {"wall_s", rounded(info.wall_s, 3)},
      {"peak_memory_MB", rounded(peakMemory_MB(), 3)},
      {"stereo_correction_rms_px",
       {{"disparity", rounded(info.correction_px.x(), 3)},
        {"rows", rounded(info.correction_px.y(), 3)}}},
      {"times", statisticsJson(collectTimes(rows), "_ms")},
      {"counts", statisticsJson(collectCounts(rows), "")},
      {"parameters", parametersJson(info.parameters)},
      {"changed_parameters", changedParametersJson(info.parameters)},
      {"weighted_residuals",
       {{"bin_width", ResidualHistogram::kBinWidth},
        {"points", residualsJson(info.point_residuals)},
        {"lines", residualsJson(info.line_residuals)}}}};
  if (info.gyroscope) summary["gyroscope"] = gyroscopeJson(*info.gyroscope);
  if (info.gravity) summary["gravity"] = gravityJson(*info.gravity);
  if (info.prior_file) summary["prior_file"] = priorFileJson(*info.prior_file);
  if (info.recording) summary["recording"] = recordingJson(*info.recording);
  // File names may have any bytes: those that are not UTF-8 are replaced.
  return summary.dump(2, ' ', false, json::error_handler_t::replace) + "\n";
}

std::set<std::string> filesOfEarlierRun(const std::string& folder) {
  std::ifstream file(std::filesystem::path(folder) / "summary.json");
  const json summary = json::parse(file, nullptr, false);
  if (!summary.is_object() || !summary.contains("version") || !summary.contains("line_detector"))
    return {};
  std::set<std::string> files{"report.html"};
  if (!summary.contains("files")) {  // of a version that did not list them
    files.insert({"trajectory.tum", "trajectory.kitti", "frames.csv", "uncertainty.csv",
                  "summary.json", "groundtruth.tum", "features", "thumbnails"});
  } else if (summary["files"].is_array()) {
    for (const json& name : summary["files"]) {
      const bool is_name = name.is_string() && !name.get<std::string>().empty() &&
                           name.get<std::string>().find('/') == std::string::npos &&
                           name.get<std::string>().front() != '.';
      if (is_name) files.insert(name.get<std::string>());
    }
  }
  return files;
}

std::string formatTable(const std::vector<FrameRow>& rows, const RunInfo& info) {
  std::ostringstream text = fixedStream(2);
  const auto heading = [&text](const char* name) {
    text << std::left << std::setw(24) << name << std::right;
    for (const char* column : {"mean", "median", "p95", "max"}) text << std::setw(10) << column;
    text << '\n';
  };
  const auto table = [&text](const std::vector<Series>& all) {
    for (const Series& series : all) {
      const Statistics s = computeStatistics(series.second);
      text << std::left << std::setw(24) << series.first << std::right;
      for (const double value : {s.mean, s.median, s.p95, s.max}) text << std::setw(10) << value;
      text << '\n';
    }
  };
  heading("time [ms]");
  table(collectTimes(rows));
  heading("count");
  table(collectCounts(rows));
  text << rows.size() << " frames in " << info.wall_s
       << " s: " << countState(rows, TrackingState::kOk) << " ok, "
       << countState(rows, TrackingState::kDegraded) << " degraded, "
       << countState(rows, TrackingState::kLost) << " lost";
  for (const auto& [reason, count] : info.refused) text << ", " << count << ' ' << toString(reason);
  text << "; peak memory " << peakMemory_MB() << " MB\n"
       << "line detector: " << info.line_detector << "; point descriptor: " << info.point_descriptor
       << '\n'
       << "variance of the weighted residuals (1: as modelled): points "
       << info.point_residuals.variance() << ", lines " << info.line_residuals.variance() << '\n';
  if (info.recording) {
    text << info.recording->equal << " of " << info.recording->frames
         << " frames equal those of the recording bit for bit; largest difference "
         << 1000.0 * info.recording->max_distance_m << " mm, "
         << info.recording->max_angle_rad * 180.0 / M_PI << " deg\n";
  }
  return text.str();
}

}  // namespace point_line_odometry
