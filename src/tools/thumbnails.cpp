#include "tools/thumbnails.h"

#include <algorithm>
#include <fstream>
#include <iomanip>
#include <opencv2/imgcodecs.hpp>
#include <sstream>

#include "common/image_resize.h"
#include "common/input_error.h"

namespace point_line_odometry {
namespace {

constexpr int kWidth_px = 320;

/// The image as JPEG, at most kWidth_px wide.
std::string encodeThumbnail(const cv::Mat& image) {
  cv::Mat small = image;
  const double scale = static_cast<double>(kWidth_px) / std::max(image.cols, 1);
  if (scale < 1.0) small = resized(image, {kWidth_px, std::max(cvRound(scale * image.rows), 1)});
  std::vector<unsigned char> bytes;
  cv::imencode(".jpg", small, bytes, {cv::IMWRITE_JPEG_QUALITY, 80});
  return {bytes.begin(), bytes.end()};
}

}  // namespace

void EvenSample::offer(std::size_t frame, const std::function<std::string()>& make) {
  const std::size_t index = count_++;
  if (index % step_ != 0) return;
  if (members_.size() == kMaxSize) {
    // Every second one stays; then the series is `kMaxSize` steps long, so that this one belongs.
    for (std::size_t i = 0; 2 * i < members_.size(); ++i) members_[i] = members_[2 * i];
    members_.resize(kMaxSize / 2);
    step_ *= 2;
  }
  members_.push_back({frame, make()});
}

void Thumbnails::offer(std::size_t frame, TrackingState state,
                       const std::function<cv::Mat()>& draw) {
  const bool is_first = state != last_;
  last_ = state;
  if (state == TrackingState::kOk) return;
  (is_first ? first_ : others_).offer(frame, [&draw] { return encodeThumbnail(draw()); });
}

void Thumbnails::write(const std::string& folder) const {
  for (const EvenSample* sample : {&first_, &others_}) {
    for (const EvenSample::Member& member : sample->members()) {
      std::ostringstream path;
      path << folder << '/' << std::setw(6) << std::setfill('0') << member.frame << ".jpg";
      std::ofstream out(path.str(), std::ios::binary);
      out << member.image;
      out.close();
      if (!out) throw InputError("'" + path.str() + "' cannot be written: make room on disk");
    }
  }
}

}  // namespace point_line_odometry
