
#include "dataset/trajectory.h"

#include <gtest/gtest.h>
#include <unistd.h>

#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <locale>
#include <sstream>

namespace point_line_odometry {
namespace {

/// A locale with decimal comma: 1.000,5
struct CommaNumbers : std::numpunct<char> {
  char do_decimal_point() const override { return ','; }
  char do_thousands_sep() const override { return '.'; }
  std::string do_grouping() const override { return "\3"; }
};

StampedPose makePose(std::int64_t stamp_ns, const Eigen::Vector3d& translation,
                     const Eigen::Quaterniond& rotation) {
  StampedPose pose;
  pose.stamp_ns = stamp_ns;
  pose.T_world_camera.linear() = rotation.toRotationMatrix();
  pose.T_world_camera.translation() = translation;
  return pose;
}

std::string tum(const std::vector<StampedPose>& trajectory) {
  std::ostringstream out;
  writeTum(out, trajectory);
  return out.str();
}

std::string kitti(const std::vector<StampedPose>& trajectory) {
  std::ostringstream out;
  writeKitti(out, trajectory);
  return out.str();
}

/// A quarter turn about y: z of the camera points along x.
const Eigen::Quaterniond kQuarterTurn(Eigen::AngleAxisd(M_PI / 2, Eigen::Vector3d::UnitY()));

TEST(WriteTum, WritesStampPositionAndQuaternion) {
  EXPECT_EQ(tum({makePose(1403636584763555584, {1.5, -2.25, 1e-3}, kQuarterTurn)}),
            "1403636584.763555584 1.500000000 -2.250000000 0.001000000 "
            "0.000000000 0.707106781 0.000000000 0.707106781\n");
}

TEST(WriteTum, KeepsLeadingZerosOfTheFraction) {
  EXPECT_EQ(tum({makePose(5, {0, 0, 0}, Eigen::Quaterniond::Identity())}).substr(0, 12),
            "0.000000005 ");
}

TEST(WriteTum, HasNoNegativeZeroAndNoNegativeW) {
  const Eigen::Quaterniond three_quarters(Eigen::AngleAxisd(1.5 * M_PI, Eigen::Vector3d::UnitY()));
  EXPECT_EQ(tum({makePose(0, {-0.0, 0, 0}, three_quarters)}),
            "0.000000000 0.000000000 0.000000000 0.000000000 "
            "0.000000000 -0.707106781 0.000000000 0.707106781\n");
}

TEST(WriteKitti, WritesRowMajorMatrix) {
  const std::vector<StampedPose> trajectory = {
      makePose(0, {0, 0, 0}, Eigen::Quaterniond::Identity()),
      makePose(1, {1, -2, 1234.5}, Eigen::Quaterniond::Identity())};
  EXPECT_EQ(kitti(trajectory),
            "1.000000000e+00 0.000000000e+00 0.000000000e+00 0.000000000e+00 "
            "0.000000000e+00 1.000000000e+00 0.000000000e+00 0.000000000e+00 "
            "0.000000000e+00 0.000000000e+00 1.000000000e+00 0.000000000e+00\n"
            "1.000000000e+00 0.000000000e+00 0.000000000e+00 1.000000000e+00 "
            "0.000000000e+00 1.000000000e+00 0.000000000e+00 -2.000000000e+00 "
            "0.000000000e+00 0.000000000e+00 1.000000000e+00 1.234500000e+03\n");
}

TEST(WriteTrajectory, DoesNotDependOnTheLocale) {
  const std::vector<StampedPose> trajectory = {makePose(5000000000, {1234.5, 0, 0}, kQuarterTurn)};
  const std::string tum_before = tum(trajectory);
  const std::string kitti_before = kitti(trajectory);
  const std::locale before =
      std::locale::global(std::locale(std::locale::classic(), new CommaNumbers));
  const std::string tum_after = tum(trajectory);
  const std::string kitti_after = kitti(trajectory);
  std::locale::global(before);
  EXPECT_EQ(tum_after, tum_before);
  EXPECT_EQ(kitti_after, kitti_before);
}

/// A temporary file for each test, removed at the end.
class ReadTumTest : public ::testing::Test {
 protected:
  void SetUp() override {
    std::string name =
        (std::filesystem::temp_directory_path() / "point_line_trajectory_XXXXXX").string();
    const int descriptor = mkstemp(name.data());
    ASSERT_NE(descriptor, -1);
    close(descriptor);
    file_ = name;
  }

  void TearDown() override { std::filesystem::remove(file_); }

  std::vector<StampedPose> readText(const std::string& text) const {
    std::ofstream(file_, std::ios::binary) << text;
    return readTum(file_);
  }

  /// Asserts that the text is refused with an error that contains the file's name and these words.
  void expectRefused(const std::string& text, const std::string& words) const {
    try {
      readText(text);
    } catch (const InputError& error) {
      EXPECT_NE(std::string(error.what()).find(words), std::string::npos) << error.what();
      EXPECT_NE(std::string(error.what()).find(file_), std::string::npos) << error.what();
      return;
    }
    ADD_FAILURE() << "was not refused: " << text;
  }

  std::string file_;
};

TEST_F(ReadTumTest, ReadsWhatWasWritten) {
  const std::vector<StampedPose> written = {
      makePose(5, {0, 0, 0}, Eigen::Quaterniond::Identity()),
      makePose(1403636584763555584, {1.5, -2.25, 1e-3}, kQuarterTurn)};
  const std::vector<StampedPose> read = readText(tum(written));
  ASSERT_EQ(read.size(), 2U);
  for (std::size_t i = 0; i < 2; ++i) {
    EXPECT_EQ(read[i].stamp_ns, written[i].stamp_ns);
    EXPECT_TRUE(read[i].T_world_camera.isApprox(written[i].T_world_camera, 1e-8));
  }
}

TEST_F(ReadTumTest, TakesCommentsBlankLinesAndWindowsLineEnds) {
  const auto read = readText("# stamp ...\r\n\r\n  1 2 3 4 0 0 0 1\r\n2.5e0\t2 3 4 0 0 0 1.001");
  ASSERT_EQ(read.size(), 2U);
  EXPECT_EQ(read[1].stamp_ns, 2500000000);
  EXPECT_TRUE(read[1].T_world_camera.linear().isIdentity(1e-12));
}

TEST_F(ReadTumTest, NamesTheRowThatIsWrong) {
  const std::string good = "1 0 0 0 0 0 0 1\n";
  expectRefused(good + "2 0 0 0 0 0 0\n", "line 2 is not the 8 numbers");
  expectRefused(good + "2 0 0 0 0 0 0 1 9\n", "line 2 is not the 8 numbers");
  expectRefused(good + "2 0 0 nan 0 0 0 1\n", "line 2 is not the 8 numbers");
  expectRefused(good + "2,0,0,0,0,0,0,1\n", "line 2 is not the 8 numbers");
  expectRefused("# x\n" + good + "2 0 0 0 0 0 0 0.5\n", "line 3 has no unit quaternion");
  expectRefused("-1 0 0 0 0 0 0 1\n", "line 1 has no stamp");
  expectRefused("1e20 0 0 0 0 0 0 1\n", "line 1 has no stamp");
  expectRefused(good + "1 0 0 0 0 0 0 1\n", "line 2 is not later");
}

TEST_F(ReadTumTest, RefusesFilesWithoutPoses) {
  expectRefused("", "has no pose");
  expectRefused("# nothing\n", "has no pose");
  EXPECT_THROW(readTum(file_ + ".gone"), InputError);
}

TEST(WriteTrajectory, WritesNothingForNoPoses) {
  EXPECT_EQ(tum({}), "");
  EXPECT_EQ(kitti({}), "");
}

}  // namespace
}  // namespace point_line_odometry
