#include "dataset/camera_info_file.h"

#include <yaml-cpp/yaml.h>

#include <cmath>
#include <iomanip>
#include <limits>
#include <locale>
#include <sstream>
#include <stdexcept>
#include <vector>

#include "dataset/text_rows.h"

namespace point_line_odometry {
namespace {

/// The numbers of a matrix in the file. \param count that it must have; 0: any.
std::vector<double> readMatrix(const YAML::Node& root, const char* name, std::size_t count) {
  const YAML::Node matrix = root[name];
  const YAML::Node data = matrix && matrix.IsMap() ? matrix["data"] : YAML::Node();
  if (!data || !data.IsSequence()) {
    throw std::invalid_argument(std::string(name) + " has no list 'data'");
  }
  auto numbers = data.as<std::vector<double>>();
  if (count > 0 && numbers.size() != count) {
    throw std::invalid_argument(std::string(name) + " has " + std::to_string(numbers.size()) +
                                " numbers, but must have " + std::to_string(count));
  }
  for (const double number : numbers) {
    if (!std::isfinite(number)) {
      throw std::invalid_argument(std::string(name) + " has a number that is not finite");
    }
  }
  return numbers;
}

int readSize(const YAML::Node& root, const char* name) {
  const int size = root[name] ? root[name].as<int>() : 0;
  if (size > 0) return size;
  throw std::invalid_argument(std::string(name) + " is missing or below 1");
}

CameraCalibration readCamera(const YAML::Node& root) {
  using RowMajor3 = Eigen::Matrix<double, 3, 3, Eigen::RowMajor>;
  using RowMajor34 = Eigen::Matrix<double, 3, 4, Eigen::RowMajor>;
  if (!root.IsMap()) throw std::invalid_argument("it is empty or no map of fields");
  CameraCalibration camera;
  camera.width = readSize(root, "image_width");
  camera.height = readSize(root, "image_height");
  if (root["distortion_model"]) {
    camera.distortion_model = root["distortion_model"].as<std::string>();
  }
  camera.D = readMatrix(root, "distortion_coefficients", 0);
  camera.K = Eigen::Map<const RowMajor3>(readMatrix(root, "camera_matrix", 9).data());
  camera.R = Eigen::Map<const RowMajor3>(readMatrix(root, "rectification_matrix", 9).data());
  camera.P = Eigen::Map<const RowMajor34>(readMatrix(root, "projection_matrix", 12).data());
  return camera;
}

/// All digits; with a point, as Python's yaml takes 1e-05 for a text.
std::string toText(double number) {
  std::ostringstream out;
  out.imbue(std::locale::classic());
  out << std::setprecision(std::numeric_limits<double>::max_digits10) << number;
  std::string text = out.str();
  const std::size_t exponent = text.find('e');
  if (exponent != std::string::npos && text.find('.') == std::string::npos) {
    text.insert(exponent, ".0");
  }
  return text;
}

/// A matrix by rows. \param rows, columns of it.
template <typename Value>
void writeMatrix(std::ostream& out, const char* name, Eigen::Index rows, Eigen::Index columns,
                 const Value& value) {
  out << name << ":\n  rows: " << rows << "\n  cols: " << columns << "\n  data: [";
  for (Eigen::Index i = 0; i < rows * columns; ++i) {
    out << (i > 0 ? ", " : "") << toText(value(i / columns, i % columns));
  }
  out << "]\n";
}

}  // namespace

CameraCalibration readCameraInfo(const std::string& file) {
  if (!isFile(file)) fail("camera_info file ", inQuotes(file), " does not exist: check the path");
  try {
    return readCamera(YAML::LoadFile(file));
  } catch (const YAML::Exception& error) {
    fail("camera_info file ", inQuotes(file), " is no yaml of camera_calibration: ", error.what());
  } catch (const std::invalid_argument& error) {
    fail("camera_info file ", inQuotes(file), " is no yaml of camera_calibration: ", error.what());
  }
}

std::string formatCameraInfo(const CameraCalibration& camera, const std::string& name) {
  std::ostringstream out;
  out.imbue(std::locale::classic());
  out << "image_width: " << camera.width << "\nimage_height: " << camera.height
      << "\ncamera_name: " << name << '\n';
  writeMatrix(out, "camera_matrix", 3, 3, [&](auto i, auto j) { return camera.K(i, j); });
  out << "distortion_model: " << camera.distortion_model << '\n';
  writeMatrix(out, "distortion_coefficients", 1, static_cast<Eigen::Index>(camera.D.size()),
              [&](auto, auto j) { return camera.D[static_cast<std::size_t>(j)]; });
  writeMatrix(out, "rectification_matrix", 3, 3, [&](auto i, auto j) { return camera.R(i, j); });
  writeMatrix(out, "projection_matrix", 3, 4, [&](auto i, auto j) { return camera.P(i, j); });
  return out.str();
}

}  // namespace point_line_odometry
