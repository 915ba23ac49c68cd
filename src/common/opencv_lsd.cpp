#include "common/opencv_lsd.h"

namespace point_line_odometry {

cv::Ptr<cv::LineSegmentDetector> createLsd() {
  try {
    cv::Ptr<cv::LineSegmentDetector> lsd = cv::createLineSegmentDetector(cv::LSD_REFINE_STD);
    cv::Mat lines;
    lsd->detect(cv::Mat::zeros(32, 32, CV_8UC1), lines);
    return lsd;
  } catch (const cv::Exception&) {
    return {};
  }
}

}  // namespace point_line_odometry
