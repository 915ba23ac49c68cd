
#include "features/point_detector.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <map>
#include <opencv2/features2d.hpp>
#include <opencv2/imgproc.hpp>

#include "features/fast_corners.h"
#include "matching/descriptor_distance.h"
#include "synthetic_scene.h"

namespace point_line_odometry {
namespace {

using Eigen::Vector2f;

/// Smooth noise: keypoints everywhere.
cv::Mat texture(int width, int height, unsigned seed, double contrast = 60.0) {
  cv::Mat noise(height, width, CV_32FC1);
  cv::RNG random(seed);
  random.fill(noise, cv::RNG::NORMAL, 0.0, 1.0);
  cv::GaussianBlur(noise, noise, {}, 1.5);
  cv::normalize(noise, noise, 1.0, 0.0, cv::NORM_INF);
  cv::Mat image;
  noise.convertTo(image, CV_8UC1, 2.0 * contrast, 128.0);
  return image;
}

PointParameters oneLevel() {
  PointParameters parameters;
  parameters.levels = 1;
  return parameters;
}

/// Detects in a slightly blurred image: FAST drops corners whose neighbours have the same score, as
/// in a drawing.
std::vector<Keypoint> detectSoftened(const cv::Mat& drawing,
                                     const PointParameters& parameters = oneLevel()) {
  cv::Mat image;
  cv::GaussianBlur(drawing, image, {}, 0.8);
  return PointDetector(parameters).detect(image);
}

const Keypoint* nearest(const std::vector<Keypoint>& features, const Vector2f& pixel) {
  const auto found =
      std::min_element(features.begin(), features.end(), [&](const Keypoint& a, const Keypoint& b) {
        return (a.pixel - pixel).norm() < (b.pixel - pixel).norm();
      });
  return found == features.end() ? nullptr : &*found;
}

std::map<std::pair<int, int>, int> perCell(const std::vector<Keypoint>& features, int cell,
                                           int offset) {
  std::map<std::pair<int, int>, int> counts;
  for (const Keypoint& feature : features) {
    ++counts[{static_cast<int>(feature.pixel.x() - offset) / cell,
              static_cast<int>(feature.pixel.y() - offset) / cell}];
  }
  return counts;
}

TEST(PointDetector, FindsTheCornersOfSquares) {
  cv::Mat image(240, 320, CV_8UC1, cv::Scalar(60));
  std::vector<Vector2f> corners;
  for (int y = 40; y < 200; y += 40) {
    for (int x = 40; x < 280; x += 40) {
      cv::rectangle(image, cv::Point(x, y), cv::Point(x + 17, y + 17), cv::Scalar(200), cv::FILLED);
      for (const int dx : {0, 17}) {
        for (const int dy : {0, 17}) corners.emplace_back(x + dx, y + dy);
      }
    }
  }
  const std::vector<Keypoint> features = detectSoftened(image);
  for (const Vector2f& corner : corners) {
    ASSERT_FALSE(features.empty());
    EXPECT_LE((nearest(features, corner)->pixel - corner).cwiseAbs().maxCoeff(), 1.01F)
        << corner.transpose();
  }
  for (const Keypoint& feature : features) {  // and nothing along the edges
    const auto distance = [&](const Vector2f& corner) { return (feature.pixel - corner).norm(); };
    EXPECT_TRUE(std::any_of(corners.begin(), corners.end(),
                            [&](const Vector2f& c) { return distance(c) < 3.0F; }));
    EXPECT_GT(feature.response, 0.0F);
    EXPECT_EQ(feature.octave, 0);
  }
}

TEST(FastCorners, AreThoseOfOpenCv) {
  constexpr int kBorder = FastCorners::kMinBorder;
  FastCorners detector;
  for (const cv::Size& size : {cv::Size(200, 150), cv::Size(57, 60), cv::Size(641, 43)}) {
    cv::Mat image = texture(size.width, size.height, 7, 90.0);
    cv::Mat rough(size, CV_8UC1);
    cv::randu(rough, 0, 40);
    image += rough;  // saturates, too
    for (const int threshold : {1, 10, 60}) {
      std::vector<cv::KeyPoint> expected;
      cv::FAST(image, expected, threshold, true);
      const auto outside = [&](const cv::KeyPoint& p) {
        // OpenCV compares scores with neighbours outside the border, too.
        return p.pt.x <= kBorder || p.pt.y <= kBorder || p.pt.x >= size.width - kBorder - 1 ||
               p.pt.y >= size.height - kBorder - 1;
      };
      expected.erase(std::remove_if(expected.begin(), expected.end(), outside), expected.end());
      std::vector<FastCorner> found = detector.detect(image, threshold, kBorder);
      found.erase(std::remove_if(
                      found.begin(), found.end(),
                      [&](const FastCorner& c) { return outside(cv::KeyPoint(c.x, c.y, 1.0F)); }),
                  found.end());
      ASSERT_EQ(found.size(), expected.size()) << size << ' ' << threshold;
      for (std::size_t i = 0; i < found.size(); ++i) {
        EXPECT_EQ(found[i].x, expected[i].pt.x);
        EXPECT_EQ(found[i].y, expected[i].pt.y);
        // OpenCV gives the largest threshold that the corner passes.
        EXPECT_EQ(found[i].score - 1, expected[i].response);
      }
    }
  }
}

TEST(FastCorners, OfCellsIncludeTheStrongest) {
  constexpr int kBorder = FastCorners::kMinBorder;
  const cv::Mat image = texture(437, 241, 11, 90.0);
  FastCorners detector;
  const std::vector<FastCorner> all = detector.detect(image, 1, kBorder);
  for (const int size : {16, 37, 50}) {
    for (const int max_per_cell : {1, 3, 8}) {
      const std::vector<FastCorner> found =
          detector.detect(image, 1, kBorder, {size, max_per_cell});
      EXPECT_LT(found.size(), all.size());
      // The strongest of each cell, the first ones of equal scores.
      const auto strongest = [&](const std::vector<FastCorner>& corners) {
        std::map<std::pair<int, int>, std::vector<std::array<int, 3>>> cells;
        for (const FastCorner& c : corners)
          cells[{(c.y - kBorder) / size, (c.x - kBorder) / size}].push_back({-c.score, c.y, c.x});
        for (auto& cell : cells) {
          std::sort(cell.second.begin(), cell.second.end());
          if (static_cast<int>(cell.second.size()) > max_per_cell)
            cell.second.resize(static_cast<std::size_t>(max_per_cell));
        }
        return cells;
      };
      EXPECT_EQ(strongest(found), strongest(all)) << size << ' ' << max_per_cell;
    }
  }
}

TEST(PointDetector, KeepsAtMostMaxPerCell) {
  const cv::Mat image = texture(400, 300, 1);
  PointParameters parameters = oneLevel();
  parameters.fast_threshold = 3;
  for (const int quota : {1, 4, 9}) {
    parameters.max_per_cell = quota;
    const std::vector<Keypoint> features = PointDetector(parameters).detect(image);
    EXPECT_GT(features.size(), 20U * quota);
    // The origin of the grid is not specified: a window of one cell touches at most four.
    for (const auto& cell : perCell(features, parameters.cell_size_px, 0))
      EXPECT_LE(cell.second, 4 * quota);
    EXPECT_LE(features.size(), static_cast<std::size_t>(8 * 6 * quota));
  }
}

TEST(PointDetector, BucketsStrongAndWeakRegions) {
  // The left half has ten times the contrast of the right half, and must not take all keypoints.
  cv::Mat image = texture(400, 240, 2, 110.0);
  cv::Mat weak = texture(400, 240, 2, 35.0);
  weak.colRange(200, 400).copyTo(image.colRange(200, 400));
  PointParameters parameters;
  parameters.max_per_cell = 5;
  const std::vector<Keypoint> features = PointDetector(parameters).detect(image);
  const auto right = std::count_if(features.begin(), features.end(),
                                   [](const Keypoint& f) { return f.pixel.x() > 205.0F; });
  EXPECT_GT(right, static_cast<std::ptrdiff_t>(features.size()) / 4);
}

TEST(PointDetector, KeepsTheStrongestOfACell) {
  cv::Mat image(120, 120, CV_8UC1, cv::Scalar(100));
  cv::circle(image, cv::Point(40, 40), 1, cv::Scalar(130), cv::FILLED);
  cv::circle(image, cv::Point(60, 60), 1, cv::Scalar(220), cv::FILLED);
  PointParameters parameters = oneLevel();
  parameters.cell_size_px = 400;
  parameters.max_per_cell = 1;
  const std::vector<Keypoint> features = detectSoftened(image, parameters);
  ASSERT_EQ(features.size(), 1U);
  EXPECT_LT((features[0].pixel - Vector2f(60.0F, 60.0F)).norm(), 1.5F);
}

TEST(PointDetector, ThresholdIsTheSmallestContrast) {
  cv::Mat image(120, 120, CV_8UC1, cv::Scalar(100));
  cv::circle(image, cv::Point(60, 60), 1, cv::Scalar(130), cv::FILLED);  // about 20 after blurring
  PointParameters parameters = oneLevel();
  parameters.fast_threshold = 8;
  EXPECT_EQ(detectSoftened(image, parameters).size(), 1U);
  parameters.fast_threshold = 35;
  EXPECT_TRUE(detectSoftened(image, parameters).empty());
}

TEST(PointDetector, IsDeterministic) {
  const cv::Mat image = texture(300, 200, 3);
  const std::vector<Keypoint> a = PointDetector({}).detect(image);
  const std::vector<Keypoint> b = PointDetector({}).detect(image.clone());
  ASSERT_EQ(a.size(), b.size());
  for (std::size_t i = 0; i < a.size(); ++i) {
    EXPECT_EQ(a[i].pixel, b[i].pixel);
    EXPECT_EQ(a[i].descriptor, b[i].descriptor);
  }
}

TEST(PointDetector, PyramidLevelsGiveFullResolutionPixels) {
  cv::Mat image(240, 320, CV_8UC1, cv::Scalar(60));
  cv::rectangle(image, cv::Point(100, 80), cv::Point(219, 159), cv::Scalar(200), cv::FILLED);
  PointParameters parameters;
  parameters.levels = 3;
  parameters.scale_factor = 1.5;
  int on_upper_levels = 0;
  for (const Keypoint& feature : detectSoftened(image, parameters)) {
    on_upper_levels += feature.octave > 0 ? 1 : 0;
    EXPECT_LT(feature.octave, 3);
    const float x =
        std::min(std::abs(feature.pixel.x() - 99.5F), std::abs(feature.pixel.x() - 219.5F));
    const float y =
        std::min(std::abs(feature.pixel.y() - 79.5F), std::abs(feature.pixel.y() - 159.5F));
    // The structure tensor of the coarser levels sums up a block of 9 x 9 px.
    const float reach = feature.octave == 0 ? 2.0F : 4.5F;
    EXPECT_LE(std::max(x, y), reach * std::pow(1.5F, static_cast<float>(feature.octave)));
  }
  EXPECT_GE(on_upper_levels, 4);
}

void expectSame(const std::vector<Keypoint>& a, const std::vector<Keypoint>& b) {
  ASSERT_EQ(a.size(), b.size());
  for (std::size_t i = 0; i < a.size(); ++i) {
    EXPECT_EQ(a[i].pixel, b[i].pixel);
    EXPECT_EQ(a[i].octave, b[i].octave);
    EXPECT_EQ(a[i].response, b[i].response);
    EXPECT_EQ(a[i].angle_rad, b[i].angle_rad);
    EXPECT_EQ(a[i].descriptor, b[i].descriptor);
  }
}

TEST(PointDetector, FinestAndCoarserLevelsTogetherAreAll) {
  const cv::Mat image = texture(401, 303, 8);
  PointParameters parameters;
  parameters.levels = 4;
  parameters.scale_factor = 1.5;
  PointDetector detector(parameters);
  std::vector<Keypoint> both = detector.detectFinest(image);
  for (const Keypoint& feature : both) EXPECT_EQ(feature.octave, 0);
  const std::vector<Keypoint> coarser = detector.detectCoarser(ImagePyramid(image, parameters));
  std::map<int, int> per_octave;
  for (const Keypoint& feature : coarser) ++per_octave[feature.octave];
  ASSERT_EQ(per_octave.size(), 3U);
  for (int octave = 1; octave <= 3; ++octave) EXPECT_GT(per_octave[octave], 8) << octave;
  both.insert(both.end(), coarser.begin(), coarser.end());
  expectSame(both, detector.detect(image));
}

TEST(PointDetector, OneLevelHasNoCoarserOnes) {
  const cv::Mat image = texture(300, 200, 9);
  PointDetector detector(oneLevel());
  EXPECT_TRUE(detector.detectCoarser(ImagePyramid(image, oneLevel())).empty());
  expectSame(detector.detectFinest(image), detector.detect(image));
}

TEST(PointDetector, CoarserLevelsDetectBlurredSpotsInTheDark) {
  cv::Mat image(300, 400, CV_32FC1, cv::Scalar(20.0));
  std::vector<Vector2f> spots;
  for (int y = 100; y <= 200; y += 50) {
    for (int x = 100; x <= 300; x += 50) {
      cv::Mat spot(image.size(), CV_32FC1, cv::Scalar(0.0));
      cv::circle(spot, cv::Point(x, y), 5, cv::Scalar(14.0), cv::FILLED);
      cv::GaussianBlur(spot, spot, {}, 2.0);
      image += spot;
      spots.emplace_back(x, y);
    }
  }
  cv::Mat grain(image.size(), CV_32FC1);
  cv::RNG(10).fill(grain, cv::RNG::NORMAL, 0.0, 4.0);
  image += grain;
  image.convertTo(image, CV_8UC1);
  PointParameters parameters;
  parameters.levels = 3;
  parameters.scale_factor = 2.0;
  PointDetector detector(parameters);
  const auto found = [&](const std::vector<Keypoint>& features) {
    return std::count_if(spots.begin(), spots.end(), [&](const Vector2f& spot) {
      const Keypoint* near = nearest(features, spot);
      return near != nullptr && (near->pixel - spot).norm() < 6.0F;
    });
  };
  const std::vector<Keypoint> coarser = detector.detectCoarser(ImagePyramid(image, parameters));
  EXPECT_EQ(found(coarser), static_cast<std::ptrdiff_t>(spots.size()));
  const auto beside = std::count_if(coarser.begin(), coarser.end(), [&](const Keypoint& corner) {
    return std::none_of(spots.begin(), spots.end(),
                        [&](const Vector2f& spot) { return (corner.pixel - spot).norm() < 18.0F; });
  });
  EXPECT_LE(beside, 2);
}

// --- Descriptors

/// Descriptor distances of keypoints to the same points of an image rotated about its centre, and
/// to other points.
struct Distances {
  std::vector<int> same;
  std::vector<int> other;
};

Distances distancesWhenTurned(double angle_deg) {
  const cv::Mat image = texture(400, 400, 4);
  const cv::Mat turn = cv::getRotationMatrix2D({199.5F, 199.5F}, angle_deg, 1.0);
  cv::Mat turned;
  cv::warpAffine(image, turned, turn, image.size(), cv::INTER_CUBIC, cv::BORDER_REFLECT);
  PointParameters parameters = oneLevel();
  parameters.max_per_cell = 200;
  const std::vector<Keypoint> before = PointDetector(parameters).detect(image);
  const std::vector<Keypoint> after = PointDetector(parameters).detect(turned);
  Distances distances;
  for (std::size_t i = 0; i < before.size(); ++i) {
    const Vector2f p = before[i].pixel;
    if ((p - Vector2f(199.5F, 199.5F)).norm() > 150.0F) continue;
    const Vector2f expected(
        static_cast<float>(turn.at<double>(0, 0) * p.x() + turn.at<double>(0, 1) * p.y() +
                           turn.at<double>(0, 2)),
        static_cast<float>(turn.at<double>(1, 0) * p.x() + turn.at<double>(1, 1) * p.y() +
                           turn.at<double>(1, 2)));
    const Keypoint* same = nearest(after, expected);
    if (same == nullptr || (same->pixel - expected).norm() > 1.0F) continue;
    distances.same.push_back(hammingDistance(before[i].descriptor, same->descriptor));
    distances.other.push_back(
        hammingDistance(before[i].descriptor, after[(7 * i + 13) % after.size()].descriptor));
  }
  return distances;
}

int median(std::vector<int> values) {
  std::nth_element(values.begin(), values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2),
                   values.end());
  return values[values.size() / 2];
}

TEST(PointDescriptor, IsInvariantToRotation) {
  for (const double angle_deg : {30.0, 90.0, 147.0}) {
    const Distances distances = distancesWhenTurned(angle_deg);
    ASSERT_GT(distances.same.size(), 100U) << angle_deg;
    EXPECT_LT(median(distances.same), 50) << angle_deg;
    EXPECT_GT(median(distances.other), 100) << angle_deg;
  }
}

TEST(PointDescriptor, OrientationPointsToTheBrighterPart) {
  // The bright part of the corner lies to the right below.
  cv::Mat image(120, 120, CV_8UC1, cv::Scalar(40));
  cv::rectangle(image, cv::Point(60, 60), cv::Point(119, 119), cv::Scalar(220), cv::FILLED);
  const std::vector<Keypoint> features = detectSoftened(image);
  const Keypoint* found = nearest(features, {60.0F, 60.0F});
  ASSERT_NE(found, nullptr);
  EXPECT_NEAR(found->angle_rad, M_PI / 4.0, 0.15);  // x right, y down
}

TEST(PointDescriptor, IgnoresBrightness) {
  const cv::Mat image = texture(300, 200, 5, 50.0);
  cv::Mat brighter;
  image.convertTo(brighter, CV_8UC1, 1.3, 20.0);
  const std::vector<Keypoint> before = PointDetector({}).detect(image);
  const std::vector<Keypoint> after = PointDetector({}).detect(brighter);
  std::vector<int> distances;
  for (const Keypoint& feature : before) {
    const Keypoint* same = nearest(after, feature.pixel);
    if (same != nullptr && (same->pixel - feature.pixel).norm() < 0.5F)
      distances.push_back(hammingDistance(feature.descriptor, same->descriptor));
  }
  ASSERT_GT(distances.size(), before.size() / 2);
  EXPECT_LT(median(distances), 12);
}

// --- Degenerate images

TEST(PointDetector, UniformImagesHaveNone) {
  for (const int grey : {0, 128, 255}) {
    EXPECT_TRUE(PointDetector({}).detect(cv::Mat(200, 300, CV_8UC1, cv::Scalar(grey))).empty());
  }
}

TEST(PointDetector, TinyImagesHaveNone) {
  PointParameters parameters;
  parameters.levels = 8;
  for (const cv::Size& size : {cv::Size(1, 1), cv::Size(3, 200), cv::Size(200, 3), cv::Size(40, 40),
                               cv::Size(41, 41), cv::Size(47, 60)}) {
    cv::Mat noise(size, CV_8UC1);
    cv::randu(noise, 0, 256);
    for (const Keypoint& feature : PointDetector(parameters).detect(noise)) {
      EXPECT_GE(feature.pixel.minCoeff(), 0.0F);
      EXPECT_LT(feature.pixel.x(), static_cast<float>(size.width));
      EXPECT_LT(feature.pixel.y(), static_cast<float>(size.height));
    }
  }
  EXPECT_TRUE(PointDetector(parameters).detect(cv::Mat(1, 1, CV_8UC1, cv::Scalar(7))).empty());
}

TEST(PointDetector, ARegionOfALargerImageIsAnImage) {
  const cv::Mat large = texture(500, 400, 6);
  const cv::Mat part = large(cv::Rect(50, 60, 300, 200));
  const std::vector<Keypoint> a = PointDetector({}).detect(part);
  const std::vector<Keypoint> b = PointDetector({}).detect(part.clone());
  ASSERT_EQ(a.size(), b.size());
  for (std::size_t i = 0; i < a.size(); ++i) EXPECT_EQ(a[i].descriptor, b[i].descriptor);
}

// --- The trained pattern

TEST(PointDetector, OrbDescribesAsOpenCvDoes) {
  const cv::Mat image = texture(320, 240, 7);
  PointParameters parameters;
  parameters.levels = 3;
  const std::vector<Keypoint> random = PointDetector(parameters).detect(image);
  parameters.descriptor = "orb";
  const std::vector<Keypoint> trained = PointDetector(parameters).detect(image);
  ASSERT_GT(trained.size(), 100U);
  ASSERT_EQ(trained.size(), random.size());
  const ImagePyramid pyramid(image, parameters);
  const cv::Ptr<cv::ORB> orb = cv::ORB::create(500, 1.2F, 1, 5);
  std::map<int, int> compared;
  for (std::size_t i = 0; i < trained.size(); ++i) {
    const Keypoint& feature = trained[i];
    EXPECT_EQ(feature.pixel, random[i].pixel);
    EXPECT_NE(feature.descriptor, random[i].descriptor);
    const Vector2f pixel = pyramid.toLevel(feature.pixel, feature.octave);
    // Nearer to the border, patterns reach beyond it, where the two continue the image differently.
    const cv::Mat& level = pyramid.levels[static_cast<std::size_t>(feature.octave)];
    constexpr int kReach = 20;
    if (!cv::Rect(kReach, kReach, level.cols - 2 * kReach, level.rows - 2 * kReach)
             .contains(cv::Point(cvRound(pixel.x()), cvRound(pixel.y()))))
      continue;
    ++compared[feature.octave];
    std::vector<cv::KeyPoint> point{{std::round(pixel.x()), std::round(pixel.y()), 31.0F,
                                     feature.angle_rad * static_cast<float>(180.0 / CV_PI),
                                     feature.response, 0}};
    cv::Mat expected;
    orb->compute(level, point, expected);
    ASSERT_EQ(expected.rows, 1);
    Descriptor bits{};
    std::memcpy(bits.data(), expected.ptr(0), sizeof(bits));
    EXPECT_LE(hammingDistance(feature.descriptor, bits), 2) << i;
  }
  for (int octave = 0; octave < 3; ++octave) EXPECT_GT(compared[octave], 0) << octave;
}

TEST(PointDetector, OrbIsInvariantToRotation) {
  PointParameters parameters = oneLevel();
  parameters.descriptor = "orb";
  const cv::Mat image = texture(240, 240, 8);
  cv::Mat turned;
  cv::rotate(image, turned, cv::ROTATE_90_CLOCKWISE);
  const std::vector<Keypoint> before = PointDetector(parameters).detect(image);
  const std::vector<Keypoint> after = PointDetector(parameters).detect(turned);
  int same = 0;
  int bits = 0;
  for (const Keypoint& feature : before) {
    const Vector2f there(239.0F - feature.pixel.y(), feature.pixel.x());
    const Keypoint* found = nearest(after, there);
    if ((found->pixel - there).norm() > 0.5F) continue;
    bits += hammingDistance(feature.descriptor, found->descriptor);
    ++same;
  }
  EXPECT_GT(same, 50);
  EXPECT_LT(bits, 40 * same) << "different points differ in 128";
}

}  // namespace
}  // namespace point_line_odometry
