#include "features/structure_tensor.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstdint>
#include <opencv2/imgproc.hpp>
#include <stdexcept>
#include <vector>

namespace point_line_odometry {
namespace {

constexpr int kBorder = 10;

cv::Mat noisyImage(cv::Size size) {
  cv::Mat image(size, CV_8UC1);
  cv::RNG(7).fill(image, cv::RNG::UNIFORM, 0, 256);
  cv::GaussianBlur(image, image, {}, 1.5);
  return image;
}

/// The eigenvalue at a pixel by its definition, in double precision.
double eigenvalueAt(const cv::Mat& image, int x, int y) {
  double xx = 0.0;
  double xy = 0.0;
  double yy = 0.0;
  const auto at = [&](int column, int row) {
    return static_cast<double>(image.at<std::uint8_t>(row, column));
  };
  for (int v = y - 4; v <= y + 4; ++v) {
    for (int u = x - 4; u <= x + 4; ++u) {
      double gx = 0.0;
      double gy = 0.0;
      for (int k = -1; k <= 1; ++k) {
        const double weight = k == 0 ? 2.0 : 1.0;
        gx += weight * (at(u + 1, v + k) - at(u - 1, v + k));
        gy += weight * (at(u + k, v + 1) - at(u + k, v - 1));
      }
      xx += gx * gx;
      xy += gx * gy;
      yy += gy * gy;
    }
  }
  return 0.5 * (xx + yy) - std::sqrt(0.25 * (xx - yy) * (xx - yy) + xy * xy);
}

TEST(StructureTensor, EigenvaluesAreThoseOfTheDefinition) {
  const cv::Mat image = noisyImage({83, 47});  // no multiple of a vector's length
  const std::vector<EigenvalueMaximum> maxima = minEigenvalueMaxima(image, 6);
  ASSERT_GT(maxima.size(), 10U);
  for (const EigenvalueMaximum& maximum : maxima) {
    const double expected = eigenvalueAt(image, maximum.x, maximum.y);
    EXPECT_NEAR(maximum.value, expected, 1e-5 * expected + 1.0);
  }
}

TEST(StructureTensor, MaximaAreThoseOfOpenCv) {
  const cv::Mat image = noisyImage({211, 150});
  cv::Mat response;
  cv::cornerMinEigenVal(image, response, kStructureTensorSide, 3);
  cv::Mat largest;
  cv::dilate(response, largest, cv::Mat());
  std::vector<cv::Point> expected;
  for (int y = kBorder; y < image.rows - kBorder; ++y) {
    for (int x = kBorder; x < image.cols - kBorder; ++x) {
      if (response.at<float>(y, x) > 0.0F && response.at<float>(y, x) >= largest.at<float>(y, x))
        expected.emplace_back(x, y);
    }
  }
  std::vector<cv::Point> found;
  for (const EigenvalueMaximum& maximum : minEigenvalueMaxima(image, kBorder))
    found.emplace_back(maximum.x, maximum.y);
  ASSERT_GT(expected.size(), 50U);
  EXPECT_EQ(found, expected);
}

TEST(StructureTensor, EdgesAndUniformImagesHaveNone) {
  EXPECT_TRUE(minEigenvalueMaxima(cv::Mat(60, 80, CV_8UC1, cv::Scalar(90)), kBorder).empty());
  cv::Mat edge(60, 80, CV_8UC1, cv::Scalar(20));
  edge.colRange(40, 80).setTo(200);
  EXPECT_TRUE(minEigenvalueMaxima(edge, kBorder).empty());
}

TEST(StructureTensor, TheStrongestContrastIsExact) {
  cv::Mat squares(60, 80, CV_8UC1, cv::Scalar(0));
  for (int y = 0; y < squares.rows; ++y) {
    for (int x = 0; x < squares.cols; ++x)
      squares.at<std::uint8_t>(y, x) = (x / 2 + y / 2) % 2 == 0 ? 255 : 0;
  }
  const std::vector<EigenvalueMaximum> maxima = minEigenvalueMaxima(squares, kBorder);
  ASSERT_FALSE(maxima.empty());
  const double expected = eigenvalueAt(squares, maxima[0].x, maxima[0].y);
  EXPECT_NEAR(maxima[0].value, expected, 1e-5 * expected);
}

TEST(StructureTensor, ImagesWithoutRoomHaveNone) {
  EXPECT_TRUE(minEigenvalueMaxima(noisyImage({20, 100}), kBorder).empty());
  EXPECT_TRUE(minEigenvalueMaxima(noisyImage({100, 20}), kBorder).empty());
  EXPECT_TRUE(minEigenvalueMaxima(noisyImage({1, 1}), kBorder).empty());
  EXPECT_NO_THROW(minEigenvalueMaxima(noisyImage({13, 13}), 6));
}

TEST(StructureTensor, BordersThatAreTooNarrowAreRefused) {
  EXPECT_THROW(minEigenvalueMaxima(noisyImage({50, 50}), 5), std::invalid_argument);
}

}  // namespace
}  // namespace point_line_odometry
