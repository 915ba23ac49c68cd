/// Halves of a side-by-side image that were cut at the wrong column, and what must not be taken for
/// such: the built-in scenes, real cameras, padding and edges.

#include "checks/seam_check.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cstdlib>
#include <filesystem>
#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>
#include <optional>
#include <utility>
#include <vector>

#include "dataset/dataset.h"
#include "world/synthetic_world.h"

namespace point_line_odometry {
namespace {

StereoImages sceneOf(const char* scene) {
  SyntheticWorldOptions options;
  options.scene = scene;
  return SyntheticWorld(options).render(5);
}

constexpr auto kScenes = {"street", "indoor", "corridor", "plaster"};

/// Halves of the image that shows both, moved to the left in it by some columns.
std::pair<cv::Mat, cv::Mat> cutAt(const StereoImages& images, int shift_px) {
  cv::Mat both;
  cv::hconcat(images.left, images.right, both);
  cv::Mat moved;
  cv::hconcat(both.colRange(shift_px, both.cols), both.colRange(0, shift_px), moved);
  const int width = images.left.cols;
  return {moved.colRange(0, width).clone(), moved.colRange(width, 2 * width).clone()};
}

TEST(CommonSeam, IsFoundAtTheBorderOfTheTwo) {
  for (const char* scene : {"street", "indoor", "corridor"}) {
    const StereoImages images = sceneOf(scene);
    for (const int shift_px : {12, 100, 600}) {
      const auto [left, right] = cutAt(images, shift_px);
      EXPECT_EQ(commonSeam(left, right), images.left.cols - shift_px) << scene;
    }
  }
}

TEST(CommonSeam, IsFoundInCompressedImages) {
  const StereoImages images = sceneOf("street");
  const auto [left, right] = cutAt(images, 100);
  const auto compressed = [](const cv::Mat& image) {
    std::vector<unsigned char> bytes;
    cv::imencode(".jpg", image, bytes, {cv::IMWRITE_JPEG_QUALITY, 80});
    return cv::imdecode(bytes, cv::IMREAD_GRAYSCALE);
  };
  EXPECT_EQ(commonSeam(compressed(left), compressed(right)), images.left.cols - 100);
  EXPECT_FALSE(commonSeam(compressed(images.left), compressed(images.right)));
}

TEST(CommonSeam, IsNotInWholeImages) {
  for (const char* scene : kScenes) {
    const StereoImages images = sceneOf(scene);
    EXPECT_FALSE(commonSeam(images.left, images.right)) << scene;
  }
}

TEST(CommonSeam, IsNotTheBorderOfPadding) {
  StereoImages images = sceneOf("street");
  for (cv::Mat* image : {&images.left, &images.right}) {
    image->colRange(0, 40) = cv::Scalar(0);
    image->colRange(image->cols - 25, image->cols) = cv::Scalar(255);
  }
  EXPECT_FALSE(commonSeam(images.left, images.right));
}

TEST(CommonSeam, IsInBothImagesInTheSamePlace) {
  const StereoImages images = sceneOf("street");
  const auto [left, right] = cutAt(images, 100);
  EXPECT_FALSE(commonSeam(left, images.right));
  EXPECT_FALSE(commonSeam(images.left, right));
  EXPECT_FALSE(commonSeam(left, cutAt(images, 110).second));
}

TEST(CommonSeam, IsNotInImagesThatCannotBeCompared) {
  const cv::Mat image(100, 100, CV_8UC1, cv::Scalar(7));
  EXPECT_FALSE(commonSeam({}, {}));
  EXPECT_FALSE(commonSeam(image, image));
  EXPECT_FALSE(commonSeam(image, image.colRange(0, 50)));
  EXPECT_FALSE(commonSeam(image.col(0), image.col(0)));
  EXPECT_FALSE(commonSeam(cv::Mat(100, 100, CV_8UC3), cv::Mat(100, 100, CV_8UC3)));
}

TEST(CommonSeam, IsNotInRealSequences) {
  const char* data = std::getenv("POINT_LINE_ODOMETRY_DATA");
  if (data == nullptr || !std::filesystem::is_directory(data)) {
    GTEST_SKIP() << "no data: set POINT_LINE_ODOMETRY_DATA to the folder of the sequences";
  }
  int count = 0;
  for (const auto& entry : std::filesystem::directory_iterator(data)) {
    const bool kitti = std::filesystem::is_directory(entry.path() / "image_0");
    if (!kitti && !std::filesystem::is_directory(entry.path() / "mav0")) continue;
    const StereoDataset dataset = StereoDataset::open(entry.path().string());
    for (std::size_t i = 0; i < dataset.size(); ++i) {
      const StereoImages images = dataset.load(i);
      EXPECT_FALSE(commonSeam(images.left, images.right)) << entry.path() << ", frame " << i;
    }
    ++count;
  }
  EXPECT_GE(count, 2);
}

}  // namespace
}  // namespace point_line_odometry
