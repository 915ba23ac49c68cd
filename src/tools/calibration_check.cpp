#include "tools/calibration_check.h"

#include <algorithm>
#include <cmath>
#include <iomanip>
#include <sstream>
#include <string>
#include <utility>

#include "common/input_error.h"
#include "common/statistics.h"
#include "odometry/image_scaling.h"

namespace point_line_odometry {
namespace {

constexpr int kColumns = 12;  // of square parts of an image

// Share of the parts of an image in which points must have been seen.
constexpr double kFewestParts = 0.15;

// Remaining disagreement beyond which a calibration is of other cameras or images. One that was
// made with care is below 0.2 px; images that are rectified by it can be matched up to two pixels
// off.
constexpr double kMostRemaining_px = 1.0;

Parameters withRefinement(Parameters parameters, bool refine) {
  parameters.tracking.refine_calibration = refine;
  return parameters;
}

/// Calibration of images that are rectified already and may come without K.
StereoCalibration usable(StereoCalibration calibration, bool raw) {
  for (CameraCalibration* camera : {&calibration.left, &calibration.right}) {
    if (raw || !camera->K.isZero(0.0)) continue;
    camera->K = camera->P.leftCols<3>();
    camera->R.setIdentity();
    camera->D.clear();
    camera->distortion_model = "plumb_bob";
  }
  return calibration;
}

/// Amounts of a displacement's columns and rows over the image.
struct DisplacementSize {
  FieldSize columns;
  FieldSize rows;
};

DisplacementSize sizeOf(const RightDisplacement& displacement, const StereoCamera& camera) {
  constexpr int kSteps = 16;
  Eigen::Array2d squares = Eigen::Array2d::Zero();
  Eigen::Array2d largest = Eigen::Array2d::Zero();
  for (int i = 0; i <= kSteps; ++i) {
    for (int j = 0; j <= kSteps; ++j) {
      const Eigen::Vector2d pixel((camera.width - 1.0) * i / kSteps,
                                  (camera.height - 1.0) * j / kSteps);
      const Eigen::Array2d amount = (pixel - displacement(pixel)).array().abs();
      squares += amount.square();
      largest = largest.max(amount);
    }
  }
  const Eigen::Array2d rms = (squares / ((kSteps + 1.0) * (kSteps + 1.0))).sqrt();
  return {{rms.x(), largest.x()}, {rms.y(), largest.y()}};
}

/// Vertical disparities of the parts. \param estimated_px is subtracted unless null.
FieldSize rowsOf(const ResidualField& right, const std::vector<Eigen::Vector2d>* estimated_px) {
  ResidualField rows = right;
  for (std::size_t i = 0; i < rows.cells.size(); ++i) {
    Eigen::Vector2d& residual_px = rows.cells[i].residual_px;
    residual_px.x() = 0.0;
    if (estimated_px != nullptr) residual_px.y() -= (*estimated_px)[i].y();
  }
  return rows.size();
}

std::string pixels(double value) {
  std::ostringstream out;
  out << std::fixed << std::setprecision(3) << value << " px";
  return out.str();
}

/// A line of the report, with the name in front.
std::string line(const std::string& name, const FieldSize& size) {
  constexpr std::size_t kWidth = 38;
  std::string padded = name;
  padded.resize(std::max(kWidth, name.size()), ' ');
  return padded + " rms " + pixels(size.rms_px) + ", largest " + pixels(size.max_px) + '\n';
}

}  // namespace

int ResidualField::used() const {
  return static_cast<int>(std::count_if(cells.begin(), cells.end(), [](const ResidualCell& cell) {
    return cell.points >= kFewestPoints;
  }));
}

FieldSize ResidualField::size() const {
  FieldSize size;
  for (const ResidualCell& cell : cells) {
    if (cell.points < kFewestPoints) continue;
    const double amount = cell.residual_px.norm();
    size.rms_px += amount * amount;
    size.max_px = std::max(size.max_px, amount);
  }
  size.rms_px = std::sqrt(size.rms_px / std::max(used(), 1));
  return size;
}

CalibrationCheck::CalibrationCheck(const StereoCalibration& calibration, bool raw,
                                   const Parameters& parameters)
    : calibration_(usable(calibration, raw)),
      camera_(rectifiedCamera(calibration_)),
      given_(camera_, withRefinement(parameters, false)),
      refined_(camera_, withRefinement(parameters, true)),
      columns_(kColumns),
      rows_(std::max(1, static_cast<int>(std::lround(static_cast<double>(kColumns) *
                                                     camera_.height / camera_.width)))),
      cell_px_(static_cast<double>(camera_.width) / kColumns),
      left_(static_cast<std::size_t>(columns_ * rows_)),
      left_refined_(left_.size()),
      right_(left_.size()) {
  if (raw) rectifier_ = std::make_unique<StereoRectifier>(calibration_);
}

std::size_t CalibrationCheck::cellOf(const Eigen::Vector2f& pixel) const {
  const auto part = [](double value, double size, int parts) {
    return std::clamp(static_cast<int>(value * parts / size), 0, parts - 1);
  };
  const int column = part(pixel.x(), camera_.width, columns_);
  const int row = part(pixel.y(), camera_.height, rows_);
  return static_cast<std::size_t>(row * columns_ + column);
}

void CalibrationCheck::add(const StereoImages& images) {
  const StereoImages rectified = rectifier_ ? rectifier_->rectify(images) : images;
  const FrameResult result = given_.process(rectified);
  if (!result.accepted()) return;
  addLeft(result, &left_);
  addRight(result);
  addLeft(refined_.process(rectified), &left_refined_);
  ++frames_;
  last_left_ = rectified.left.clone();  // the images of some sources live until the next ones
  last_right_ = rectified.right.clone();
}

void CalibrationCheck::addLeft(const FrameResult& result, SamplesOfParts* samples) const {
  for (const ObservedPoint& point : result.points) {
    if (!point.inlier) continue;
    Samples& cell = (*samples)[cellOf(point.left_px)];
    cell.columns.push_back(point.residual_px[0]);
    cell.rows.push_back(point.residual_px[1]);
  }
}

void CalibrationCheck::addRight(const FrameResult& result) {
  for (const ObservedPoint& point : result.points) {
    if (!point.inlier) continue;
    Samples& cell = right_[cellOf(point.right_px)];
    cell.columns.push_back(point.residual_px[2]);
    cell.rows.push_back(point.vertical_disparity_px);
  }
}

ResidualField CalibrationCheck::medians(const SamplesOfParts& samples) const {
  ResidualField field;
  for (int i = 0; i < columns_ * rows_; ++i) {
    const Samples& of_cell = samples[static_cast<std::size_t>(i)];
    ResidualCell cell;
    cell.points = static_cast<int>(of_cell.columns.size());
    cell.centre_px << (i % columns_ + 0.5) * camera_.width / columns_,
        (i / columns_ + 0.5) * camera_.height / rows_;
    if (cell.points > 0) cell.residual_px << median(of_cell.columns), median(of_cell.rows);
    field.cells.push_back(cell);
  }
  return field;
}

/// The odometry may process images of another size; integer pixels are centres.
RightDisplacement CalibrationCheck::displacement() const {
  const StereoCamera processed = ImageScaling(camera_, refined_.parameters().tracking).camera();
  const double ratio = camera_.fx / processed.fx;
  return [correction = refined_.correction(), ratio](const Eigen::Vector2d& pixel) {
    const Eigen::Vector2d half = Eigen::Vector2d::Constant(0.5);
    return (ratio * (correction.apply((pixel + half) / ratio - half) + half) - half).eval();
  };
}

CalibrationReport CalibrationCheck::report() const {
  CalibrationReport report;
  report.camera = camera_;
  report.frames = frames_;
  report.cell_px = cell_px_;
  report.left = medians(left_);
  report.left_refined = medians(left_refined_);
  report.right = medians(right_);
  std::vector<float> vertical;
  for (const Samples& cell : right_) {
    for (const float row : cell.rows) vertical.push_back(std::abs(row));
  }
  report.points = static_cast<int>(vertical.size());
  const int parts = columns_ * rows_;
  if (report.right.used() < kFewestParts * parts) {
    throw InputError("only " + std::to_string(report.points) + " points in " +
                     std::to_string(frames_) + " pairs, enough of them in " +
                     std::to_string(report.right.used()) + " of " + std::to_string(parts) +
                     " parts of the image: too few to tell anything; the doctor says what is wrong "
                     "with the images, or move the camera before more of a scene");
  }
  if (!vertical.empty()) report.vertical_disparity_median_px = median(std::move(vertical));
  const RightDisplacement displacement = this->displacement();
  for (const ResidualCell& cell : report.right.cells) {
    report.estimated_px.push_back(cell.centre_px - displacement(cell.centre_px));
  }
  const DisplacementSize size = sizeOf(displacement, camera_);
  report.columns_estimated = size.columns;
  report.rows_estimated = size.rows;
  correct(displacement, &report);
  report.last_left = last_left_;
  report.last_right = last_right_;
  return report;
}

void CalibrationCheck::correct(const RightDisplacement& displacement,
                               CalibrationReport* report) const {
  constexpr double kRemainingShare = 0.8;
  report->rows = rowsOf(report->right, nullptr);
  report->rows_refined = rowsOf(report->right, &report->estimated_px);
  report->corrects_rows = report->rows_refined.rms_px < kRemainingShare * report->rows.rms_px;
  report->corrects_columns =
      report->left_refined.size().rms_px < kRemainingShare * report->left.size().rms_px;
  const Eigen::Vector2d taken(report->corrects_columns ? 1.0 : 0.0,
                              report->corrects_rows ? 1.0 : 0.0);
  const RightDisplacement certain = [&](const Eigen::Vector2d& pixel) {
    return (pixel + taken.cwiseProduct(displacement(pixel) - pixel)).eval();
  };
  const FieldSize& rows = report->corrects_rows ? report->rows_refined : report->rows;
  const FieldSize left =
      report->corrects_columns ? report->left_refined.size() : report->left.size();
  report->agrees = std::max(rows.rms_px, left.rms_px) <= kMostRemaining_px;
  if (report->corrects_columns || report->corrects_rows) {
    report->corrected = correctedCalibration(calibration_, certain);
  } else {
    report->corrected.calibration = calibration_;
  }
}

std::string formatReport(const CalibrationReport& report) {
  std::string text =
      std::to_string(report.frames) + " pairs, " + std::to_string(report.points) +
      " points; vertical disparity: median amount " + pixels(report.vertical_disparity_median_px) +
      '\n' + "medians of parts of the image\n" + line("  vertical disparity", report.rows) +
      line("  without what is estimated", report.rows_refined) +
      line("  reprojection residual, left image", report.left.size()) +
      line("  with online stereo calibration", report.left_refined.size()) +
      "estimated displacement of the right image\n" + line("  rows", report.rows_estimated) +
      line("  columns: bias of the disparity", report.columns_estimated);
  if (!report.agrees) {
    return text +
           "the calibration does not agree with the images, and cannot be corrected by them: the "
           "doctor says more; calibrate these cameras at this resolution\n";
  }
  if (!report.corrects_rows && !report.corrects_columns) {
    return text + "the calibration agrees with the images: nothing to be corrected\n";
  }
  text += report.corrects_rows && report.corrects_columns ? "corrected: rows and columns\n"
          : report.corrects_rows                          ? "corrected: rows\n"
                                                          : "corrected: columns\n";
  return text + line("  change of the right image", report.corrected.change) +
         line("  what camera_info cannot express", report.corrected.remaining);
}

}  // namespace point_line_odometry
