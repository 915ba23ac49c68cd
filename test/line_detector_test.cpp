
#include "features/line_detector.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <functional>
#include <opencv2/imgproc.hpp>

#include "features/a_contrario.h"
#include "features/features.h"
#include "features/gradient.h"
#include "features/line_descriptor.h"
#include "features/lsd_detector.h"
#include "features/stereo_feature_detector.h"
#include "matching/descriptor_distance.h"
#include "point_line_odometry/parameters.h"
#include "point_line_odometry/types.h"
#include "synthetic_scene.h"

namespace point_line_odometry {
namespace {

using Eigen::Vector2d;

/// Fills an image by a function of the position, averaged over 5 x 5 samples per pixel.
cv::Mat render(int width, int height, const std::function<double(const Vector2d&)>& brightness) {
  constexpr int kSamples = 5;
  cv::Mat image(height, width, CV_8UC1);
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) {
      double sum = 0.0;
      for (int i = 0; i < kSamples * kSamples; ++i) {
        sum += brightness(
            {x - 0.5 + (i % kSamples + 0.5) / kSamples, y - 0.5 + (i / kSamples + 0.5) / kSamples});
      }
      image.at<uchar>(y, x) = cv::saturate_cast<uchar>(sum / (kSamples * kSamples));
    }
  }
  return image;
}

void addNoise(cv::Mat* image, double sigma, unsigned seed) {
  cv::Mat noise(image->size(), CV_16SC1);
  cv::RNG random(seed);
  random.fill(noise, cv::RNG::NORMAL, 0.0, sigma);
  cv::add(*image, noise, *image, cv::noArray(), CV_8UC1);
}

GradientImage gradientOf(const cv::Mat& image) {
  GradientImage gradient;
  computeGradient(image, &gradient);
  return gradient;
}

std::vector<LineSegment> detect(const cv::Mat& image, const LineParameters& parameters = {}) {
  return LineDetector(parameters).detect(gradientOf(image));
}

constexpr int kSize = 200;
const Vector2d kMiddle(100.3, 99.8);

/// A bright half plane ends at a line through kMiddle: bright where the normal points to.
cv::Mat halfPlane(double normal_rad) {
  const Vector2d normal(std::cos(normal_rad), std::sin(normal_rad));
  return render(kSize, kSize,
                [&](const Vector2d& p) { return normal.dot(p - kMiddle) > 0.0 ? 160.0 : 60.0; });
}

// --- Gradient

TEST(ComputeGradient, EightUnitsAreOneGreyLevelPerPixel) {
  const cv::Mat ramp =
      render(60, 40, [](const Vector2d& p) { return 20.0 + 3.0 * p.x() + 1.0 * p.y(); });
  const GradientImage gradient = gradientOf(ramp);
  EXPECT_EQ(gradient.gx.type(), CV_16SC1);
  EXPECT_EQ(gradient.magnitude.type(), CV_16UC1);
  EXPECT_NEAR(gradient.gx.at<short>(20, 30), 24, 1);
  EXPECT_NEAR(gradient.gy.at<short>(20, 30), 8, 1);
  EXPECT_NEAR(gradient.magnitude.at<ushort>(20, 30), 32, 2);
}

// --- Accuracy and direction

TEST(LineDetector, FindsEdgesToSubpixelsAtEveryAngle) {
  for (int degrees = 0; degrees < 360; degrees += 5) {
    const double angle = (degrees + 0.7) * M_PI / 180.0;
    const Vector2d normal(std::cos(angle), std::sin(angle));
    const std::vector<LineSegment> segments = detect(halfPlane(angle));
    ASSERT_FALSE(segments.empty()) << degrees;
    const LineSegment& longest = segments[0];
    EXPECT_LT(std::abs(normal.dot(longest.start.cast<double>() - kMiddle)), 0.05) << degrees;
    EXPECT_LT(std::abs(normal.dot(longest.end.cast<double>() - kMiddle)), 0.05) << degrees;
    EXPECT_GT(longest.length(), 150.0F) << degrees;
    // Brighter on the right: x right, y down, right of (1, 0) is (0, 1).
    const Vector2d right_hand(-longest.direction().y(), longest.direction().x());
    EXPECT_GT(right_hand.dot(normal), 0.9999) << degrees;
  }
}

TEST(LineDetector, FindsAnEdgeOnce) {
  for (int degrees = 0; degrees < 360; degrees += 15) {
    EXPECT_EQ(detect(halfPlane((degrees + 0.7) * M_PI / 180.0)).size(), 1U) << degrees;
  }
}

TEST(LineDetector, IsRobustToNoise) {
  for (int degrees = 3; degrees < 360; degrees += 40) {
    const double angle = degrees * M_PI / 180.0;
    cv::Mat image = halfPlane(angle);
    addNoise(&image, 5.0, static_cast<unsigned>(degrees));
    const std::vector<LineSegment> segments = detect(image);
    ASSERT_FALSE(segments.empty());
    const Vector2d normal(std::cos(angle), std::sin(angle));
    for (const Eigen::Vector2f& end : {segments[0].start, segments[0].end}) {
      EXPECT_LT(std::abs(normal.dot(end.cast<double>() - kMiddle)), 0.4) << degrees;
    }
    EXPECT_GT(segments[0].length(), 120.0F) << degrees;
  }
}

TEST(LineDetector, FindsThePolygonsSides) {
  // A bright triangle: its sides, each from corner to corner, with the bright inside on the right.
  const std::array<Vector2d, 3> corners{Vector2d(40.0, 50.0), Vector2d(160.0, 70.0),
                                        Vector2d(80.0, 165.0)};
  const auto cross = [](const Vector2d& a, const Vector2d& b) {
    return a.x() * b.y() - a.y() * b.x();
  };
  const auto inside = [&](const Vector2d& p) {
    return cross(corners[1] - corners[0], p - corners[0]) > 0.0 &&
           cross(corners[2] - corners[1], p - corners[1]) > 0.0 &&
           cross(corners[0] - corners[2], p - corners[2]) > 0.0;
  };
  const std::vector<LineSegment> segments =
      detect(render(kSize, kSize, [&](const Vector2d& p) { return inside(p) ? 180.0 : 70.0; }));
  ASSERT_EQ(segments.size(), 3U);
  for (int side = 0; side < 3; ++side) {
    const Vector2d& from = corners[side];
    const Vector2d& to = corners[(side + 1) % 3];
    EXPECT_TRUE(std::any_of(segments.begin(), segments.end(), [&](const LineSegment& s) {
      return (s.start.cast<double>() - from).norm() < 14.0 &&
             (s.end.cast<double>() - to).norm() < 14.0;
    })) << side;
  }
}

TEST(LineDetector, BothEdgesOfABarAreFoundWithOppositeDirections) {
  const std::vector<LineSegment> segments = detect(render(
      kSize, kSize, [](const Vector2d& p) { return p.x() > 90.0 && p.x() < 98.0 ? 180.0 : 70.0; }));
  ASSERT_EQ(segments.size(), 2U);
  EXPECT_LT(segments[0].direction().dot(segments[1].direction()), -0.9999F);
}

TEST(LineDetector, AGentleRampIsNotAnEdge) {
  EXPECT_TRUE(detect(render(kSize, kSize, [](const Vector2d& p) { return 20.0 + p.x(); })).empty());
}

// --- A-contrario

TEST(LineDetector, NoiseHasAlmostNoSegments) {
  std::size_t segments = 0;
  for (unsigned seed = 1; seed <= 10; ++seed) {
    cv::Mat image(240, 320, CV_8UC1, cv::Scalar(128));
    addNoise(&image, 25.0, seed);
    segments += detect(image).size();
  }
  EXPECT_LE(segments, 5U);
}

TEST(AContrarioTable, RequiresMoreInLargerImagesAndLongerSegments) {
  const AContrarioTable table(cv::Size(640, 480));
  EXPECT_EQ(table.imageSize(), cv::Size(640, 480));
  const auto fewest = [](const AContrarioTable& t, int n) {
    int k = 0;
    while (k <= n && !t.meaningful(n, k)) ++k;
    return k;
  };
  EXPECT_GT(fewest(table, 10), 10);  // ten pixels are never enough: 640 * 480 ^ 2.5 tests
  EXPECT_LE(fewest(table, 20), 20);
  EXPECT_GT(fewest(AContrarioTable(cv::Size(4000, 3000)), 40),
            fewest(AContrarioTable(cv::Size(64, 48)), 40));
  for (int n = 20; n < 1000; ++n) {
    EXPECT_LE(fewest(table, n), fewest(table, n + 1)) << n;
    EXPECT_GT(fewest(table, n), n / 8) << "more than by chance";
  }
}

TEST(AContrarioTable, AgreesWithTheBinomialTail) {
  const cv::Size size(320, 240);
  const AContrarioTable table(size);
  const auto false_alarms = [&](int n, int aligned) {
    double tail = 0.0;
    for (int i = aligned; i <= n; ++i) {
      tail += std::exp(std::lgamma(n + 1.0) - std::lgamma(i + 1.0) - std::lgamma(n - i + 1.0) +
                       i * std::log(0.125) + (n - i) * std::log(0.875));
    }
    return tail * std::pow(static_cast<double>(size.area()), 2.5);
  };
  for (const int n : {12, 20, 35, 80, 200}) {
    for (int aligned = 1; aligned <= n; ++aligned) {
      EXPECT_EQ(table.meaningful(n, aligned), false_alarms(n, aligned) <= 1.0)
          << n << ' ' << aligned;
    }
  }
}

// --- Options

/// Upright bright bars with the given heights, 26 px apart.
cv::Mat bars(const std::vector<int>& heights) {
  return render(26 * static_cast<int>(heights.size()) + 30, kSize, [&](const Vector2d& p) {
    const double place = (p.x() - 20.3) / 26.0;
    const int i = static_cast<int>(std::floor(place));
    if (i < 0 || i >= static_cast<int>(heights.size()) || place - i > 0.47) return 70.0;
    return p.y() > 20.0 && p.y() < 20.0 + heights[static_cast<std::size_t>(i)] ? 180.0 : 70.0;
  });
}

TEST(LineDetector, MaxCountKeepsTheLongest) {
  LineParameters parameters;
  const cv::Mat image = bars({60, 110, 80, 160, 70, 130});
  const std::vector<LineSegment> all = detect(image, parameters);
  ASSERT_EQ(all.size(), 12U);
  parameters.max_count = 4;
  const std::vector<LineSegment> longest = detect(image, parameters);
  ASSERT_EQ(longest.size(), 4U);
  for (std::size_t i = 0; i < 4; ++i) {
    EXPECT_EQ(longest[i].start, all[i].start);
    EXPECT_GT(longest[i].length(), 100.0F);
  }
  for (std::size_t i = 1; i < all.size(); ++i) EXPECT_GE(all[i - 1].length(), all[i].length());
}

TEST(LineDetector, MinLengthDropsShorterOnes) {
  LineParameters parameters;
  const cv::Mat image = bars({60, 110, 80, 160, 70, 130});
  for (const double length : {40.0, 85.0, 130.0}) {
    parameters.min_length_px = length;
    const std::vector<LineSegment> segments = detect(image, parameters);
    EXPECT_EQ(segments.size(), length == 40.0 ? 12U : length == 85.0 ? 6U : 2U);
    for (const LineSegment& segment : segments) EXPECT_GE(segment.length(), length);
  }
}

TEST(LineDetector, MinGradientDropsWeakerOnes) {
  LineParameters parameters;
  const cv::Mat faint =
      render(kSize, kSize, [](const Vector2d& p) { return p.x() > 90.2 ? 118.0 : 100.0; });
  parameters.min_gradient = 2.0;
  EXPECT_EQ(detect(faint, parameters).size(), 1U);
  parameters.min_gradient = 20.0;
  EXPECT_TRUE(detect(faint, parameters).empty());
}

TEST(LineDetector, MaxDeviationBreaksCurves) {
  const cv::Mat disc = render(
      kSize, kSize, [](const Vector2d& p) { return (p - kMiddle).norm() < 80.0 ? 180.0 : 70.0; });
  LineParameters parameters;
  parameters.min_length_px = 10.0;
  parameters.max_deviation_px = 0.4;
  const std::vector<LineSegment> strict = detect(disc, parameters);
  parameters.max_deviation_px = 2.0;
  const std::vector<LineSegment> loose = detect(disc, parameters);
  ASSERT_FALSE(strict.empty() || loose.empty());
  EXPECT_GT(loose[0].length(), 1.3F * strict[0].length());
  EXPECT_LT(loose[0].length(), 100.0F);
}

TEST(LineDetector, BridgesTheGapWhereAWireCrosses) {
  for (const double angle : {0.1, 0.3, 0.7}) {
    const Vector2d along(std::cos(angle), std::sin(angle));
    const Vector2d across(-std::sin(angle), std::cos(angle));
    const cv::Mat image = render(kSize, kSize, [&](const Vector2d& p) {
      if (std::abs(across.dot(p - kMiddle)) < 1.0) return 70.0;
      return along.dot(p - kMiddle) > -9.8 ? 170.0 : 80.0;
    });
    const std::vector<LineSegment> segments = detect(image);
    EXPECT_TRUE(std::any_of(segments.begin(), segments.end(), [&](const LineSegment& s) {
      return s.length() > 180.0F && std::abs(s.direction().cast<double>().dot(across)) > 0.999;
    })) << angle;
  }
}

// --- Degenerate images

TEST(LineDetector, UniformAndTinyImagesHaveNone) {
  EXPECT_TRUE(detect(cv::Mat(100, 100, CV_8UC1, cv::Scalar(77))).empty());
  for (const cv::Size& size :
       {cv::Size(1, 1), cv::Size(2, 50), cv::Size(50, 2), cv::Size(3, 3), cv::Size(8, 8)}) {
    cv::Mat noise(size, CV_8UC1);
    cv::randu(noise, 0, 256);
    EXPECT_TRUE(detect(noise).empty()) << size;
  }
}

TEST(LineDetector, OneDetectorProcessesImagesOfSeveralSizes) {
  LineDetector detector({});
  const cv::Mat large = bars({60, 110, 80, 160, 70, 130});
  const cv::Mat small = large(cv::Rect(0, 0, 60, 120)).clone();
  for (int round = 0; round < 2; ++round) {
    for (const cv::Mat& image : {large, small}) {
      const std::vector<LineSegment> kept = detector.detect(gradientOf(image));
      const std::vector<LineSegment> fresh = detect(image);
      ASSERT_EQ(kept.size(), fresh.size());
      for (std::size_t i = 0; i < kept.size(); ++i) EXPECT_EQ(kept[i].start, fresh[i].start);
    }
  }
}

// --- Descriptors

/// A vertical edge with its own surroundings.
cv::Mat edgeAmidTexture(unsigned seed) {
  cv::Mat image(kSize, kSize, CV_32FC1);
  cv::RNG random(seed);
  random.fill(image, cv::RNG::NORMAL, 0.0, 1.0);
  cv::GaussianBlur(image, image, {}, 4.0);
  cv::normalize(image, image, 1.0, 0.0, cv::NORM_INF);
  image.convertTo(image, CV_32FC1, 45.0, 100.0);
  cv::Mat(image.colRange(100, kSize)) += 50.0F;
  image.convertTo(image, CV_8UC1);
  return image;
}

const LineSegment kEdge{{99.5F, 160.0F}, {99.5F, 40.0F}};

Descriptor describe(const cv::Mat& image, const LineSegment& segment = kEdge) {
  return describeLines(gradientOf(image), {segment}).at(0);
}

TEST(DescribeLines, SameSegmentSameDescriptor) {
  EXPECT_EQ(describe(edgeAmidTexture(1)), describe(edgeAmidTexture(1)));
  EXPECT_NE(describe(edgeAmidTexture(1)), Descriptor{});
}

TEST(DescribeLines, IgnoresBrightness) {
  for (unsigned seed = 1; seed <= 10; ++seed) {
    const cv::Mat image = edgeAmidTexture(seed);
    cv::Mat offset;
    cv::Mat gain;
    image.convertTo(offset, CV_8UC1, 1.0, 20.0);
    image.convertTo(gain, CV_8UC1, 1.2, -5.0);
    EXPECT_LE(hammingDistance(describe(image), describe(offset)), 2) << seed;
    EXPECT_LE(hammingDistance(describe(image), describe(gain)), 20) << seed;
  }
}

TEST(DescribeLines, AreRobustToNoiseAndASmallShift) {
  for (unsigned seed = 1; seed <= 10; ++seed) {
    cv::Mat noisy = edgeAmidTexture(seed);
    addNoise(&noisy, 3.0, seed);
    const LineSegment slid{{99.7F, 155.0F}, {99.4F, 42.0F}};
    EXPECT_LE(hammingDistance(describe(edgeAmidTexture(seed)), describe(noisy, slid)), 45) << seed;
  }
}

TEST(DescribeLines, DistinguishesSurroundings) {
  std::vector<int> distances;
  for (unsigned a = 1; a <= 12; ++a) {
    for (unsigned b = a + 1; b <= 12; ++b)
      distances.push_back(
          hammingDistance(describe(edgeAmidTexture(a)), describe(edgeAmidTexture(b))));
  }
  std::sort(distances.begin(), distances.end());
  EXPECT_GT(distances[distances.size() / 2], 35);
  EXPECT_GT(distances.front(), 5);
}

TEST(DescribeLines, IsInvariantToRotation) {
  const cv::Mat image = edgeAmidTexture(3);
  cv::Mat turned;
  cv::rotate(image, turned, cv::ROTATE_90_CLOCKWISE);  // (x, y) -> (kSize - 1 - y, x)
  const LineSegment segment{{kSize - 1 - kEdge.start.y(), kEdge.start.x()},
                            {kSize - 1 - kEdge.end.y(), kEdge.end.x()}};
  EXPECT_LE(hammingDistance(describe(image), describe(turned, segment)), 30);
}

TEST(DescribeLines, HandlesSamplesOutsideTheImage) {
  const cv::Mat image = edgeAmidTexture(4);
  const std::vector<LineSegment> segments{{{0.0F, 0.0F}, {0.0F, 199.0F}},
                                          {{199.0F, 199.0F}, {150.0F, 199.0F}},
                                          {{-50.0F, -50.0F}, {400.0F, 300.0F}},
                                          {{10.0F, 10.0F}, {10.0F, 10.0F}}};
  EXPECT_EQ(describeLines(gradientOf(image), segments).size(), 4U);
  EXPECT_TRUE(describeLines(gradientOf(image), {}).empty());
}

// --- OpenCV's LSD

class LsdDetectorTest : public ::testing::Test {
 protected:
  void SetUp() override {
    if (!LsdDetector::isAvailable()) GTEST_SKIP() << "this OpenCV has no line segment detector";
  }

  static std::vector<LineSegment> detectLsd(const cv::Mat& image,
                                            const LineParameters& parameters = {}) {
    return LsdDetector(parameters).detect(image);
  }
};

TEST_F(LsdDetectorTest, FindsEdgesAtEveryAngleWithTheBrighterSideOnTheRight) {
  Vector2d sum = Vector2d::Zero();  // of the offsets from the edge
  for (int degrees = 0; degrees < 360; degrees += 10) {
    const double angle = (degrees + 0.7) * M_PI / 180.0;
    const Vector2d normal(std::cos(angle), std::sin(angle));
    const std::vector<LineSegment> segments = detectLsd(halfPlane(angle));
    ASSERT_FALSE(segments.empty()) << degrees;
    const LineSegment& longest = segments[0];
    const double offset = normal.dot(longest.middle().cast<double>() - kMiddle);
    EXPECT_LT(std::abs(offset), 0.3) << degrees;
    sum += 2.0 / 36.0 * offset * normal;
    EXPECT_GT(longest.length(), 100.0F) << degrees;
    const Vector2d right_hand(-longest.direction().y(), longest.direction().x());
    EXPECT_GT(right_hand.dot(normal), 0.999) << degrees;
  }
  EXPECT_LT(sum.norm(), 0.07) << "edges are unbiased: " << sum.transpose();
}

TEST_F(LsdDetectorTest, KeepsTheLongestThatAreLongEnough) {
  LineParameters parameters;
  const cv::Mat image = synthetic::frame(0).left;
  const std::vector<LineSegment> all = detectLsd(image, parameters);
  ASSERT_GT(all.size(), 20U);
  EXPECT_TRUE(std::is_sorted(all.begin(), all.end(),
                             [](const auto& a, const auto& b) { return a.length() > b.length(); }));
  EXPECT_GE(all.back().length(), parameters.min_length_px);
  parameters.max_count = 10;
  EXPECT_EQ(detectLsd(image, parameters).size(), 10U);
  parameters = {};
  parameters.min_length_px = all[10].length();
  EXPECT_EQ(detectLsd(image, parameters).size(), 11U);
}

TEST_F(LsdDetectorTest, SmallAndUniformImagesHaveNone) {
  for (const cv::Size& size : {cv::Size(1, 1), cv::Size(2, 9), cv::Size(9, 2), cv::Size(60, 40)}) {
    EXPECT_TRUE(detectLsd(cv::Mat(size, CV_8UC1, cv::Scalar(90))).empty()) << size;
  }
}

TEST(LineDetectorKind, IsTheConfiguredOneOrItsFallback) {
  const auto kind = [](const char* detector, bool available) {
    LineParameters parameters;
    parameters.detector = detector;
    return std::string(toString(lineDetectorKind(parameters, [=] { return available; })));
  };
  EXPECT_EQ(kind("edge_chains", true), "edge_chains");
  EXPECT_EQ(kind("edge_chains", false), "edge_chains");
  EXPECT_EQ(kind("lsd_or_edge_chains", true), "lsd");
  EXPECT_EQ(kind("lsd_or_edge_chains", false), "edge_chains");
  EXPECT_EQ(kind("lsd", true), "lsd");
  EXPECT_EQ(kind("lsd", false), "lsd") << "checkParameters() refuses it; no fallback";
  LineParameters off;
  off.enabled = false;
  EXPECT_STREQ(toString(lineDetectorKind(off, [] { return true; })), "none");
}

TEST(LineDetectorKind, InUseIsReported) {
  LineParameters parameters;
  parameters.detector = "lsd_or_edge_chains";
  StereoFeatureDetector detector({}, parameters);
  ThreadPool threads(2);
  const DetectedFeatures features =
      detector.detect(synthetic::frame(0), LineResolution::kFull, &threads);
  const cv::Mat& image = synthetic::frame(0).left;
  const bool lsd = LsdDetector::isAvailable();
  EXPECT_EQ(detector.lineDetector(), lsd ? LineDetectorKind::kLsd : LineDetectorKind::kEdgeChains);
  const std::vector<LineSegment> expected =
      lsd ? LsdDetector(parameters).detect(image) : detect(image, parameters);
  ASSERT_EQ(features.lines_left.size(), expected.size());
  for (std::size_t i = 0; i < expected.size(); ++i)
    EXPECT_EQ(features.lines_left[i].segment.start, expected[i].start);
}

}  // namespace
}  // namespace point_line_odometry
