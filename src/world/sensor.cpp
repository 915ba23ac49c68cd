#include "world/sensor.h"

#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>

#include "world/random.h"

namespace point_line_odometry::world {
namespace {

constexpr float kWhite = 235.0F;  // grey level of light 1 at exposure 0

/// Approximately normal with variance 1: the sum of four random bytes.
float gaussian(std::uint32_t bits) {
  constexpr float kMean = 510.0F;
  constexpr float kDeviation = 147.8F;
  const std::uint32_t sum =
      (bits & 0xffU) + ((bits >> 8) & 0xffU) + ((bits >> 16) & 0xffU) + (bits >> 24);
  return (static_cast<float>(sum) - kMean) / kDeviation;
}

/// Standard deviation of the noise at a grey level: read noise and shot noise.
float noiseDeviation(float grey, float at_middle) {
  return at_middle * std::sqrt(0.3F + 0.7F * std::max(0.0F, grey) / 128.0F);
}

}  // namespace

cv::Mat expose(const cv::Mat& light, const Sensor& sensor, std::uint32_t seed) {
  cv::Mat blurred = light;
  if (sensor.lens_blur_px > 0.0) {
    cv::GaussianBlur(light, blurred, cv::Size(), sensor.lens_blur_px, 0.0, cv::BORDER_REPLICATE);
  }
  const auto gain = kWhite * static_cast<float>(std::exp2(sensor.exposure_ev));
  const auto noise = static_cast<float>(sensor.noise);
  const float centre_x = 0.5F * static_cast<float>(light.cols - 1);
  const float centre_y = 0.5F * static_cast<float>(light.rows - 1);
  const float loss =
      static_cast<float>(sensor.vignetting) / (centre_x * centre_x + centre_y * centre_y);
  cv::Mat image(light.size(), CV_8UC1);
  for (int y = 0; y < light.rows; ++y) {
    const float* in = blurred.ptr<float>(y);
    std::uint8_t* out = image.ptr<std::uint8_t>(y);
    const float dy = static_cast<float>(y) - centre_y;
    for (int x = 0; x < light.cols; ++x) {
      const float dx = static_cast<float>(x) - centre_x;
      float grey = gain * in[x] * (1.0F - loss * (dx * dx + dy * dy));
      const std::uint32_t bits =
          hash(seed, static_cast<std::uint32_t>(x), static_cast<std::uint32_t>(y));
      grey += noiseDeviation(grey, noise) * gaussian(bits);
      out[x] = static_cast<std::uint8_t>(std::min(255.0F, std::max(0.0F, grey + 0.5F)));
    }
  }
  return image;
}

}  // namespace point_line_odometry::world
