/// \file
/// Loaded before OpenCV (LD_PRELOAD), this takes its line segment detector away, as OpenCV 4.1.0 to
/// 4.5.3 have it: the class is there and cannot be made.

#include <opencv2/imgproc.hpp>

namespace cv {

Ptr<LineSegmentDetector> createLineSegmentDetector(int, double, double, double, double, double,
                                                   double, int) {
  CV_Error(Error::StsNotImplemented, "Implementation has been removed");
}

}  // namespace cv
