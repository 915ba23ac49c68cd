#include "tools/thumbnails.h"

#include <gtest/gtest.h>

#include <filesystem>
#include <opencv2/imgcodecs.hpp>
#include <string>
#include <vector>

#include "common/input_error.h"

namespace point_line_odometry {
namespace {

std::vector<std::size_t> framesOf(const EvenSample& sample) {
  std::vector<std::size_t> frames;
  for (const EvenSample::Member& member : sample.members()) frames.push_back(member.frame);
  return frames;
}

TEST(EvenSample, KeepsAllOfAShortSeries) {
  EvenSample sample;
  for (std::size_t i = 0; i < EvenSample::kMaxSize; ++i) sample.offer(10 * i, [] { return "x"; });
  const std::vector<std::size_t> frames = framesOf(sample);
  ASSERT_EQ(frames.size(), EvenSample::kMaxSize);
  for (std::size_t i = 0; i < frames.size(); ++i) EXPECT_EQ(frames[i], 10 * i);
}

TEST(EvenSample, IsEvenOverALongSeries) {
  for (const std::size_t size : {17U, 100U, 1000U, 4097U}) {
    EvenSample sample;
    std::size_t made = 0;
    for (std::size_t i = 0; i < size; ++i) {
      sample.offer(i, [&made] {
        ++made;
        return "x";
      });
    }
    const std::vector<std::size_t> frames = framesOf(sample);
    ASSERT_GT(frames.size(), EvenSample::kMaxSize / 2) << size;
    ASSERT_LE(frames.size(), EvenSample::kMaxSize) << size;
    EXPECT_LT(made, 16 * 10U);  // images are drawn only for those that are kept, at first
    const std::size_t step = frames[1] - frames[0];
    for (std::size_t i = 0; i < frames.size(); ++i) EXPECT_EQ(frames[i], i * step) << size;
    EXPECT_GT(frames.back() + step, size - 1) << size;
  }
}

class ThumbnailsTest : public ::testing::Test {
 protected:
  ThumbnailsTest()
      : folder_(std::filesystem::temp_directory_path() /
                ("thumbnails_" + std::to_string(::testing::UnitTest::GetInstance()->random_seed()) +
                 ::testing::UnitTest::GetInstance()->current_test_info()->name())) {
    std::filesystem::create_directories(folder_);
  }
  ~ThumbnailsTest() override { std::filesystem::remove_all(folder_); }

  cv::Mat read(const std::string& name) const { return cv::imread((folder_ / name).string()); }

  std::filesystem::path folder_;
};

TEST_F(ThumbnailsTest, KeepsSmallImagesOfFramesThatAreNotOk) {
  Thumbnails thumbnails;
  const cv::Mat wide(300, 1200, CV_8UC3, cv::Scalar(10, 200, 90));
  const cv::Mat small(100, 200, CV_8UC1, cv::Scalar(77));
  thumbnails.offer(0, TrackingState::kOk, [&]() -> cv::Mat {
    ADD_FAILURE() << "drawn for nothing";
    return wide;
  });
  thumbnails.offer(1, TrackingState::kLost, [&] { return wide; });
  thumbnails.offer(2, TrackingState::kDegraded, [&] { return small; });
  thumbnails.write(folder_.string());
  EXPECT_TRUE(read("000000.jpg").empty());
  EXPECT_EQ(read("000001.jpg").size(), cv::Size(320, 80));
  EXPECT_NEAR(read("000001.jpg").at<cv::Vec3b>(40, 160)[1], 200, 3);
  EXPECT_EQ(read("000002.jpg").size(), small.size());
}

TEST_F(ThumbnailsTest, KeepsBeginningsAmongManyOthers) {
  Thumbnails thumbnails;
  const cv::Mat image(10, 10, CV_8UC1, cv::Scalar(0));
  for (std::size_t i = 0; i < 1000; ++i) {
    const bool is_lost = i >= 400 && i != 700;
    thumbnails.offer(i, is_lost ? TrackingState::kLost : TrackingState::kOk, [&] { return image; });
  }
  thumbnails.write(folder_.string());
  EXPECT_FALSE(read("000400.jpg").empty());
  EXPECT_FALSE(read("000701.jpg").empty());
  std::size_t count = 0;
  for (const auto& entry : std::filesystem::directory_iterator(folder_))
    count += entry.is_regular_file() ? 1 : 0;
  EXPECT_LE(count, 2 * EvenSample::kMaxSize);
}

TEST_F(ThumbnailsTest, SaysWhereItCannotWrite) {
  Thumbnails thumbnails;
  thumbnails.offer(0, TrackingState::kLost, [] { return cv::Mat(4, 4, CV_8UC1, cv::Scalar(0)); });
  EXPECT_THROW(thumbnails.write((folder_ / "missing").string()), InputError);
}

}  // namespace
}  // namespace point_line_odometry
