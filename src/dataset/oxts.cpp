#include "dataset/oxts.h"

#include <Eigen/Geometry>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "dataset/text_rows.h"

namespace point_line_odometry {
namespace {

namespace fs = std::filesystem;

/// Days since 1970-01-01 in the Gregorian calendar.
std::int64_t daysOf(int year, int month, int day) {
  const std::int64_t y = month > 2 ? year : year - 1;
  const std::int64_t m = month > 2 ? month - 3 : month + 9;  // from March on
  return 365 * y + y / 4 - y / 100 + y / 400 + (153 * m + 2) / 5 + day - 1 - 719468;
}

/// "2011-09-26 13:02:25.964389445", in nanoseconds since 1970.
std::int64_t parseTime(const std::string& row, const fs::path& file) {
  int year = 0;
  int month = 0;
  int day = 0;
  int hour = 0;
  int minute = 0;
  int second = 0;
  int read = 0;
  const int fields = std::sscanf(row.c_str(), "%4d-%2d-%2d %2d:%2d:%2d%n", &year, &month, &day,
                                 &hour, &minute, &second, &read);
  std::string fraction;
  if (fields == 6 && static_cast<std::size_t>(read) < row.size())
    fraction = row.substr(static_cast<std::size_t>(read));
  const bool is_fraction =
      fraction.empty() || (fraction.size() >= 2 && fraction.front() == '.' &&
                           fraction.find_first_not_of("0123456789", 1) == std::string::npos);
  const bool in_range = year >= 1970 && year <= 2095 && month >= 1 && month <= 12 && day >= 1 &&
                        day <= 31 && hour >= 0 && hour < 24 && minute >= 0 && minute < 60 &&
                        second >= 0 && second <= 60;
  if (fields != 6 || !is_fraction || !in_range) {
    fail("file ", inQuotes(file), " has the row '", row,
         "', but must hold times as 2011-09-26 13:02:25.964389445");
  }
  std::string digits = fraction.empty() ? "" : fraction.substr(1);
  digits.resize(9, '0');
  const std::int64_t seconds = ((daysOf(year, month, day) * 24 + hour) * 60 + minute) * 60 + second;
  return 1000000000 * seconds + std::stoll(digits);
}

fs::path findCalibration(const fs::path& folder, const std::string& name) {
  for (const fs::path& place :
       {folder / name, fs::absolute(folder).lexically_normal() / ".." / name})
    if (isFile(place)) return place;
  fail("folder ", inQuotes(folder), " has an oxts folder, but no ", name,
       " here or above it: fetch the calibration of that day, or remove oxts");
}

/// The numbers of the row "NAME: ...".
std::vector<double> readRow(const fs::path& file, const std::string& name, std::size_t count) {
  for (const std::string& row : readLines(file)) {
    if (row.rfind(name + ":", 0) != 0) continue;
    std::vector<double> numbers = parseNumbers(row.substr(name.size() + 1), file);
    if (numbers.size() == count) return numbers;
    break;
  }
  fail("calibration ", inQuotes(file), " has no row '", name, ":' of ", count,
       " numbers: fetch it again");
}

Eigen::Matrix3d readRotation(const fs::path& file, const std::string& name) {
  const std::vector<double> n = readRow(file, name, 9);
  const Eigen::Matrix3d R =
      Eigen::Map<const Eigen::Matrix<double, 3, 3, Eigen::RowMajor>>(n.data());
  if (!(R * R.transpose()).isIdentity(1e-3) || !(R.determinant() > 0.0))
    fail("calibration ", inQuotes(file), ": row '", name, ":' is no rotation; fetch it again");
  return Eigen::Quaterniond(R).normalized().toRotationMatrix();
}

Eigen::Isometry3d readPose(const fs::path& file) {
  Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
  T.linear() = readRotation(file, "R");
  const std::vector<double> t = readRow(file, "T", 3);
  T.translation() << t[0], t[1], t[2];
  return T;
}

std::optional<std::int64_t> timeOfFirstImage(const fs::path& folder) {
  for (const char* images : {"image_00", "image_0"}) {
    const fs::path file = folder / images / "timestamps.txt";
    if (!isFile(file)) continue;
    const std::vector<std::string> rows = readLines(file);
    if (rows.empty()) fail("file ", inQuotes(file), " is empty: fetch it again");
    return parseTime(rows.front(), file);
  }
  return std::nullopt;
}

/// Of a packet of 30 numbers: ax ay az are its 12th to 14th, wx wy wz its 18th to 20th.
ImuSample readPacket(const fs::path& file) {
  const std::vector<std::string> rows = readLines(file);
  const std::vector<double> n =
      rows.size() == 1 ? parseNumbers(rows.front(), file) : std::vector<double>();
  if (n.size() != 30) {
    fail("file ", inQuotes(file), " has ", n.size(),
         " numbers instead of the 30 of a packet; fetch it again");
  }
  ImuSample sample;
  sample.acceleration << n[11], n[12], n[13];
  sample.angular_velocity << n[17], n[18], n[19];
  return sample;
}

}  // namespace

ImuData readOxts(const std::string& folder, std::int64_t first_ns) {
  const fs::path path(folder);
  ImuData data;
  const Eigen::Isometry3d T_velo_imu = readPose(findCalibration(path, "calib_imu_to_velo.txt"));
  const Eigen::Isometry3d T_camera_velo = readPose(findCalibration(path, "calib_velo_to_cam.txt"));
  Eigen::Isometry3d T_rectified_camera = Eigen::Isometry3d::Identity();
  T_rectified_camera.linear() =
      readRotation(findCalibration(path, "calib_cam_to_cam.txt"), "R_rect_00");
  data.T_imu_camera = (T_rectified_camera * T_camera_velo * T_velo_imu).inverse();
  const fs::path times = path / "oxts" / "timestamps.txt";
  std::optional<std::int64_t> start = timeOfFirstImage(path);
  std::size_t index = 0;
  for (const std::string& row : readLines(times)) {
    const std::int64_t time = parseTime(row, times);
    if (!start) start = time;
    std::string name = std::to_string(index++);
    name.insert(0, name.size() < 10 ? 10 - name.size() : 0, '0');
    const fs::path file = path / "oxts" / "data" / (name + ".txt");
    if (!isFile(file)) continue;  // some drives lack packets
    data.samples.push_back(readPacket(file));
    data.samples.back().stamp_ns = first_ns + time - *start;
  }
  if (data.samples.empty())
    fail("folder ", inQuotes(path / "oxts"), " has no packet: unpack the drive completely");
  return data;
}

}  // namespace point_line_odometry
