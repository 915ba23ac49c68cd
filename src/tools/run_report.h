#pragma once

#include <sys/resource.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <iomanip>
#include <locale>
#include <map>
#include <numeric>
#include <optional>
#include <sstream>
#include <string>
#include <utility>
#include <vector>

#include "dataset/classic_stream.h"
#include "point_line_odometry/parameters.h"
#include "point_line_odometry/stereo_odometry.h"
#include "point_line_odometry/trajectory.h"
#include "tools/recording_source.h"

namespace point_line_odometry {

/// Pose and twist of a frame, and what they claim to be known to; of the camera of the FrameRow.
struct FrameUncertainty {
  Matrix6d pose_covariance = Matrix6d::Zero();  ///< along and about the axes of the first camera
  Vector6d twist = Vector6d::Zero();            ///< in the camera's axes
  Matrix6d twist_covariance = Matrix6d::Zero();
  double twist_over_s = 0.0;  ///< as in FrameResult
};

/// What is kept of a frame for the files of a run.
struct FrameRow {
  StampedPose pose;  ///< of the left camera (of the raw one if images were rectified)
  TrackingState state = TrackingState::kInitializing;
  TrackingReason reason = TrackingReason::kNone;
  FrameCounts counts;
  double rms_px = 0.0;
  StageTimes times;
  double decode_ms = 0.0;
  double rectify_ms = 0.0;
  FrameUncertainty uncertainty;
};

/// What is told of a run besides its frames.
struct RunInfo {
  std::string input;
  std::string line_detector;     ///< that ran
  std::string point_descriptor;  ///< likewise
  std::size_t unpaired_images = 0;
  double wall_s = 0.0;
  ResidualHistogram point_residuals;  ///< of all frames
  ResidualHistogram line_residuals;
  std::optional<RecordingComparison> recording;  ///< of the replay of a recording
  Parameters parameters;                         ///< in force at the end
};

/// Mean and quantiles of a series.
struct Statistics {
  double mean = 0.0;
  double median = 0.0;
  double p95 = 0.0;
  double max = 0.0;
};

/// A named series, e.g. the times of a stage [ms], one per frame.
using Series = std::pair<std::string, std::vector<double>>;

/// All zero for an empty series; quantiles by nearest rank.
inline Statistics computeStatistics(std::vector<double> values) {
  if (values.empty()) return {};
  std::sort(values.begin(), values.end());
  const auto quantile = [&values](double share) {
    const double rank = std::ceil(share * static_cast<double>(values.size()));
    return values[static_cast<std::size_t>(std::max(rank, 1.0)) - 1];
  };
  const double sum = std::accumulate(values.begin(), values.end(), 0.0);
  return {sum / static_cast<double>(values.size()), quantile(0.5), quantile(0.95), values.back()};
}

/// Names and values of FrameCounts, as in the columns of frames.csv.
inline std::vector<std::pair<const char*, int>> listCounts(const FrameCounts& c) {
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

/// Names and values of the times of a frame [ms]: every stage, their total, and what came before.
inline std::vector<std::pair<std::string, double>> listTimes(const FrameRow& row) {
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

inline std::vector<Series> collectTimes(const std::vector<FrameRow>& rows) {
  std::vector<Series> series;
  for (const auto& time : listTimes(FrameRow()))
    series.emplace_back(time.first, std::vector<double>());
  for (const FrameRow& row : rows) {
    const auto times = listTimes(row);
    for (std::size_t i = 0; i < times.size(); ++i) series[i].second.push_back(times[i].second);
  }
  return series;
}

inline std::vector<Series> collectCounts(const std::vector<FrameRow>& rows) {
  std::vector<Series> series;
  for (const auto& count : listCounts({})) series.emplace_back(count.first, std::vector<double>());
  for (const FrameRow& row : rows) {
    const auto counts = listCounts(row.counts);
    for (std::size_t i = 0; i < counts.size(); ++i) series[i].second.push_back(counts[i].second);
  }
  return series;
}

/// Largest memory that the process had [MB].
inline double peakMemory_MB() {
  rusage usage{};
  getrusage(RUSAGE_SELF, &usage);
  return static_cast<double>(usage.ru_maxrss) / 1024.0;
}

/// Formats in the classic locale with fixed decimals.
inline std::ostringstream fixedStream(int decimals) {
  std::ostringstream text = classicStream();
  text << std::fixed << std::setprecision(decimals);
  return text;
}

/// frames.csv: a row for every frame.
inline std::string formatFramesCsv(const std::vector<FrameRow>& rows) {
  std::ostringstream text = fixedStream(4);
  text << "stamp_s,state,reason";
  for (const auto& count : listCounts({})) text << ',' << count.first;
  text << ",rms_px";
  for (const auto& time : listTimes(FrameRow())) text << ',' << time.first << "_ms";
  text << '\n';
  for (const FrameRow& row : rows) {
    writeStamp(text, row.pose.stamp_ns);
    text << ',' << toString(row.state) << ',' << toString(row.reason);
    for (const auto& count : listCounts(row.counts)) text << ',' << count.second;
    text << ',' << row.rms_px;
    for (const auto& time : listTimes(row)) text << ',' << time.second;
    text << '\n';
  }
  return text.str();
}

/// uncertainty.csv: a row for every frame with its twist and the upper triangles, row by row, of
/// the covariances of twist and pose; (x, y, z, about x, about y, about z) in m, rad and s.
inline std::string formatUncertaintyCsv(const std::vector<FrameRow>& rows) {
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

/// A JSON string with its quotes.
inline std::string quoteJson(const std::string& text) {
  std::string quoted = "\"";
  for (const char c : text) {
    if (c == '"' || c == '\\') quoted += '\\';
    quoted += static_cast<unsigned char>(c) < 0x20 ? ' ' : c;
  }
  return quoted + '"';
}

inline std::string formatStatisticsJson(const std::vector<Series>& all, const std::string& suffix) {
  std::ostringstream text = fixedStream(4);
  const char* separator = "";
  for (const Series& series : all) {
    const Statistics s = computeStatistics(series.second);
    text << separator << "\n    " << quoteJson(series.first + suffix) << ": {\"mean\": " << s.mean
         << ", \"median\": " << s.median << ", \"p95\": " << s.p95 << ", \"max\": " << s.max << '}';
    separator = ",";
  }
  return text.str();
}

inline std::string formatHistogramJson(const std::map<std::string, std::size_t>& histogram) {
  std::ostringstream text = fixedStream(0);
  const char* separator = "";
  for (const auto& [name, count] : histogram) {
    text << separator << quoteJson(name) << ": " << count;
    separator = ", ";
  }
  return "{" + text.str() + "}";
}

inline std::size_t countState(const std::vector<FrameRow>& rows, TrackingState state) {
  return static_cast<std::size_t>(std::count_if(
      rows.begin(), rows.end(), [state](const FrameRow& row) { return row.state == state; }));
}

/// A count over all frames.
inline int sumOf(int FrameCounts::*count, const std::vector<FrameRow>& rows) {
  return std::accumulate(rows.begin(), rows.end(), 0,
                         [count](int sum, const FrameRow& row) { return sum + row.counts.*count; });
}

inline std::string formatResidualsJson(const ResidualHistogram& residuals) {
  std::ostringstream text = fixedStream(4);
  text << "{\"size\": " << residuals.size() << ", \"variance\": " << residuals.variance()
       << ", \"counts\": [";
  const char* separator = "";
  for (const std::int64_t count : residuals.counts) {
    text << separator << count;
    separator = ", ";
  }
  return text.str() + "]}";
}

/// A member of summary.json: how near the replay of a recording came; empty if it was none.
inline std::string formatRecordingJson(const std::optional<RecordingComparison>& recording) {
  if (!recording) return "";
  std::ostringstream text = classicStream();
  text << "  \"recording\": {\"frames\": " << recording->frames
       << ", \"equal_frames\": " << recording->equal
       << ", \"max_distance_m\": " << recording->max_distance_m
       << ", \"max_angle_deg\": " << recording->max_angle_rad * 180.0 / M_PI << "},\n";
  return text.str();
}

/// Name and value of every parameter, both as texts for --set.
inline std::string formatParametersJson(const Parameters& parameters) {
  std::string text;
  for (const auto& [name, value] : parameterTexts(parameters)) {
    if (!text.empty()) text += ',';
    text += "\n    " + quoteJson(name) + ": " + quoteJson(value);
  }
  return "{" + text + "\n  }";
}

/// summary.json: what a script wants to know of the run.
inline std::string formatSummaryJson(const std::vector<FrameRow>& rows, const RunInfo& info) {
  std::map<std::string, std::size_t> states;
  std::map<std::string, std::size_t> reasons;
  for (const FrameRow& row : rows) {
    ++states[toString(row.state)];
    ++reasons[toString(row.reason)];
  }
  std::ostringstream text = fixedStream(3);
  text << "{\n  \"input\": " << quoteJson(info.input)
       << ",\n  \"line_detector\": " << quoteJson(info.line_detector)
       << ",\n  \"point_descriptor\": " << quoteJson(info.point_descriptor)
       << ",\n  \"frames\": " << rows.size()
       << ",\n  \"degraded\": " << countState(rows, TrackingState::kDegraded)
       << ",\n  \"lost\": " << countState(rows, TrackingState::kLost)
       << ",\n  \"failed_windows\": " << sumOf(&FrameCounts::failed_windows, rows)
       << ",\n  \"relocalizations\": " << sumOf(&FrameCounts::relocalizations, rows)
       << ",\n  \"states\": " << formatHistogramJson(states)
       << ",\n  \"reasons\": " << formatHistogramJson(reasons) << ",\n"
       << formatRecordingJson(info.recording) << "  \"unpaired_images\": " << info.unpaired_images
       << ",\n  \"wall_s\": " << info.wall_s << ",\n  \"peak_memory_MB\": " << peakMemory_MB()
       << ",\n  \"times\": {" << formatStatisticsJson(collectTimes(rows), "_ms")
       << "\n  },\n  \"counts\": {" << formatStatisticsJson(collectCounts(rows), "")
       << "\n  },\n  \"parameters\": " << formatParametersJson(info.parameters)
       << ",\n  \"weighted_residuals\": {\"bin_width\": " << ResidualHistogram::kBinWidth
       << ",\n    \"points\": " << formatResidualsJson(info.point_residuals)
       << ",\n    \"lines\": " << formatResidualsJson(info.line_residuals) << "}\n}\n";
  return text.str();
}

/// The short table that is printed at the end of a run.
inline std::string formatTable(const std::vector<FrameRow>& rows, const RunInfo& info) {
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
       << countState(rows, TrackingState::kLost) << " lost; peak memory " << peakMemory_MB()
       << " MB\n"
       << "line detector: " << info.line_detector << "; point descriptor: " << info.point_descriptor
       << '\n'
       << "variance of the residuals over what their weights say: points "
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
