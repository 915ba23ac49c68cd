
#include "dataset/dataset.h"

#include <gtest/gtest.h>
#include <unistd.h>

#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <opencv2/imgcodecs.hpp>
#include <optional>
#include <string>

#include "dataset/dataset_writer.h"

namespace point_line_odometry {
namespace {

namespace fs = std::filesystem;

constexpr int kWidth = 64;
constexpr int kHeight = 48;

void writeText(const fs::path& file, const std::string& text) {
  fs::create_directories(file.parent_path());
  std::ofstream(file, std::ios::binary) << text;
}

void writeImage(const fs::path& file, int value, cv::Size size = {kWidth, kHeight}) {
  fs::create_directories(file.parent_path());
  ASSERT_TRUE(cv::imwrite(file.string(), cv::Mat(size, CV_8UC1, cv::Scalar(value))));
}

/// Cuts the second half of a file off.
void cutOff(const fs::path& file) { fs::resize_file(file, fs::file_size(file) / 2); }

/// A temporary folder for each test, removed at the end.
class DatasetTest : public ::testing::Test {
 protected:
  void SetUp() override {
    std::string name = (fs::temp_directory_path() / "point_line_dataset_XXXXXX").string();
    ASSERT_NE(mkdtemp(name.data()), nullptr);
    root_ = name;
  }

  void TearDown() override { fs::remove_all(root_); }

  /// Asserts that the folder is refused with an error that contains all these words.
  void expectRefused(const std::vector<std::string>& words) const {
    try {
      const StereoDataset dataset = StereoDataset::open(folder());
      for (std::size_t i = 0; i < dataset.size(); ++i) dataset.load(i);
    } catch (const InputError& error) {
      const std::string text = error.what();
      for (const std::string& word : words) {
        EXPECT_NE(text.find(word), std::string::npos) << "no '" << word << "' in: " << text;
      }
      EXPECT_EQ(text.find('\n'), std::string::npos) << text;
      return;
    }
    ADD_FAILURE() << "was not refused";
  }

  std::string folder() const { return (root_ / "sequence").string(); }
  fs::path file(const std::string& name) const { return fs::path(folder()) / name; }

  fs::path root_;
};

// --- KITTI ------------------------------------------------------------------------------------

class KittiDatasetTest : public DatasetTest {
 protected:
  void SetUp() override {
    DatasetTest::SetUp();
    for (int i = 0; i < 3; ++i) {
      const std::string name = "00000" + std::to_string(i) + ".png";
      writeImage(file("image_0") / name, 10 + i);
      writeImage(file("image_1") / name, 20 + i);
    }
    writeText(file("times.txt"), "0.000000e+00\n1.037000e-01\n2.074000e-01\n");
    writeCalibration("-20");
  }

  void writeCalibration(const std::string& right_p3) const {
    writeText(file("calib.txt"), "P0: 50 0 32 0 0 50 24 0 0 0 1 0\nP1: 50 0 32 " + right_p3 +
                                     " 0 50 24 0 0 0 1 0\nTr: 1 2 3\n");
  }
};

TEST_F(KittiDatasetTest, ReadsIndexCalibrationAndImages) {
  const StereoDataset dataset = StereoDataset::open(folder());
  ASSERT_EQ(dataset.size(), 3U);
  EXPECT_EQ(dataset.frame(1).stamp_ns, 103700000);
  EXPECT_FALSE(dataset.needsRectification());
  EXPECT_FALSE(dataset.T_body_camera().has_value());
  EXPECT_TRUE(dataset.groundTruth().empty());

  const StereoCamera camera = rectifiedCamera(dataset.calibration());
  EXPECT_EQ(camera.fx, 50.0);
  EXPECT_EQ(camera.cy, 24.0);
  EXPECT_EQ(camera.baseline_m, 0.4);
  EXPECT_EQ(camera.width, kWidth);
  EXPECT_EQ(camera.height, kHeight);

  const StereoImages images = dataset.load(2);
  EXPECT_EQ(images.stamp_ns, 207400000);
  EXPECT_EQ(images.left.type(), CV_8UC1);
  EXPECT_EQ(images.left.at<std::uint8_t>(5, 5), 12);
  EXPECT_EQ(images.right.at<std::uint8_t>(5, 5), 22);
}

TEST_F(KittiDatasetTest, TakesWindowsLineEnds) {
  writeText(file("times.txt"), "0\r\n0.1\r\n0.2\r\n");
  EXPECT_EQ(StereoDataset::open(folder()).frame(2).stamp_ns, 200000000);
}

TEST_F(KittiDatasetTest, IgnoresWhatIsNoImage) {
  writeText(file("image_0/._000000.png"), "of macOS");
  std::filesystem::create_directory(file("image_1/more.png"));
  EXPECT_EQ(StereoDataset::open(folder()).size(), 3U);
}

TEST_F(KittiDatasetTest, StampsSince1970HaveTheirNanoseconds) {
  writeText(file("times.txt"),
            "1700000000.123456789\n1700000000.223456789\n1700000000.323456789\n");
  EXPECT_EQ(StereoDataset::open(folder()).frame(1).stamp_ns, 1700000000223456789);
}

TEST_F(KittiDatasetTest, ReadsPosesOfTheFolder) {
  writeText(file("poses.txt"),
            "1 0 0 0 0 1 0 0 0 0 1 0\n1 0 0 0.1 0 1 0 0 0 0 1 1\n0 0 1 1 0 1 0 2 -1 0 0 3\n");
  const StereoDataset dataset = StereoDataset::open(folder());
  ASSERT_EQ(dataset.groundTruth().size(), 3U);
  const StampedPose& last = dataset.groundTruth()[2];
  EXPECT_EQ(last.stamp_ns, 207400000);
  EXPECT_EQ(last.T_world_camera.translation(), Eigen::Vector3d(1, 2, 3));
  EXPECT_EQ(last.T_world_camera(2, 0), -1.0);
}

TEST_F(KittiDatasetTest, FindsPosesAtThePathOfThePublishedDataSet) {
  fs::create_directories(root_ / "sequences");
  fs::rename(folder(), root_ / "sequences" / "07");
  const std::string row = "1 0 0 0 0 1 0 0 0 0 1 0\n";
  writeText(root_ / "poses" / "07.txt", row + row + row);
  const std::string sequence = (root_ / "sequences" / "07").string();
  EXPECT_EQ(StereoDataset::open(sequence).groundTruth().size(), 3U);
  EXPECT_EQ(StereoDataset::open(sequence + "/").groundTruth().size(), 3U);
}

TEST_F(KittiDatasetTest, RefusesNamesWhoseOrderIsNotThatOfTheirNumbers) {
  for (const char* name : {"image_0", "image_1"}) {
    fs::rename(file(std::string(name) + "/000000.png"), file(std::string(name) + "/2.png"));
    fs::rename(file(std::string(name) + "/000001.png"), file(std::string(name) + "/10.png"));
  }
  expectRefused({"image_0", "different numbers of digits", "000000.png"});
}

TEST_F(KittiDatasetTest, RefusesPosesThatAreNone) {
  writeText(file("poses.txt"),
            "1 0 0 0 0 1 0 0 0 0 1 0\n1 0 0 0 0 1 0 0 0 0 1 0\n0 0 0 0 0 0 0 0 0 0 0 0\n");
  expectRefused({"poses.txt", "row 3", "rotation"});
}

TEST_F(KittiDatasetTest, RefusesMissingFolder) {
  fs::remove_all(folder());
  expectRefused({"does not exist", "check the path"});
}

TEST_F(KittiDatasetTest, RefusesFileInPlaceOfFolder) {
  fs::remove_all(folder());
  writeText(folder(), "text");
  expectRefused({"not a folder"});
}

TEST_F(KittiDatasetTest, RefusesFolderOfAnotherKind) {
  fs::remove_all(folder());
  writeText(file("notes.txt"), "text");
  expectRefused({"holds no data set", "KITTI", "EuRoC"});
}

TEST_F(KittiDatasetTest, RefusesEmptySequence) {
  for (const char* name : {"image_0", "image_1"}) {
    fs::remove_all(file(name));
    fs::create_directory(file(name));
  }
  expectRefused({"is empty", "image_0"});
}

TEST_F(KittiDatasetTest, RefusesMissingRightImages) {
  fs::remove_all(file("image_1"));
  expectRefused({"image_1", "is missing"});
}

TEST_F(KittiDatasetTest, RefusesDifferentNumbersOfImages) {
  fs::remove(file("image_1/000002.png"));
  expectRefused({"is truncated", "image_0 has 3", "image_1 2"});
}

TEST_F(KittiDatasetTest, RefusesDifferentNumberOfTimes) {
  writeText(file("times.txt"), "0\n0.1\n");
  expectRefused({"is truncated", "times.txt 2"});
}

TEST_F(KittiDatasetTest, RefusesImagesOfDifferentNames) {
  fs::rename(file("image_1/000002.png"), file("image_1/000007.png"));
  expectRefused({"is truncated", "000002.png"});
}

TEST_F(KittiDatasetTest, RefusesMissingTimes) {
  fs::remove(file("times.txt"));
  expectRefused({"times.txt", "is missing"});
}

TEST_F(KittiDatasetTest, RefusesTimesThatAreNoNumbers) {
  writeText(file("times.txt"), "0\nsoon\n0.2\n");
  expectRefused({"times.txt", "'soon'"});
}

TEST_F(KittiDatasetTest, RefusesNegativeTime) {
  writeText(file("times.txt"), "-1\n0\n0.2\n");
  expectRefused({"times.txt", "'-1'"});
}

TEST_F(KittiDatasetTest, RefusesMissingCalibration) {
  fs::remove(file("calib.txt"));
  expectRefused({"calib.txt", "is missing"});
}

TEST_F(KittiDatasetTest, RefusesCalibrationWithoutRightCamera) {
  writeText(file("calib.txt"), "P0: 50 0 32 0 0 50 24 0 0 0 1 0\n");
  expectRefused({"calib.txt", "P1"});
}

TEST_F(KittiDatasetTest, RefusesCalibrationThatIsCutOff) {
  writeText(file("calib.txt"), "P0: 50 0 32 0 0 50 24 0 0 0 1 0\nP1: 50 0 32\n");
  expectRefused({"calib.txt", "3 numbers instead of 12"});
}

TEST_F(KittiDatasetTest, RefusesNegativeBaseline) {
  writeCalibration("20");
  expectRefused({"calib.txt", "baseline of -0.4", "swap"});
}

TEST_F(KittiDatasetTest, RefusesZeroBaseline) {
  writeCalibration("0");
  expectRefused({"calib.txt", "no baseline"});
}

TEST_F(KittiDatasetTest, RefusesPosesOfAnotherSequence) {
  writeText(file("poses.txt"), "1 0 0 0 0 1 0 0 0 0 1 0\n");
  expectRefused({"poses.txt", "1 rows for 3 images"});
}

TEST_F(KittiDatasetTest, RefusesImageThatIsCutOff) {
  cutOff(file("image_1/000001.png"));
  expectRefused({"image_1/000001.png", "cannot be decoded"});
}

TEST_F(KittiDatasetTest, RefusesEmptyImage) {
  writeText(file("image_0/000002.png"), "");
  expectRefused({"image_0/000002.png", "cannot be decoded"});
}

TEST_F(KittiDatasetTest, RefusesImageOfAnotherSize) {
  writeImage(file("image_1/000001.png"), 0, {kWidth, kHeight - 1});
  expectRefused({"image_1/000001.png", "64 x 47", "64 x 48"});
}

/// The IMU of KITTI raw beside the images: 10 Hz, mounted as in the published drives.
class OxtsTest : public KittiDatasetTest {
 protected:
  void SetUp() override {
    KittiDatasetTest::SetUp();
    writeText(file("oxts/timestamps.txt"),
              "2011-09-26 23:59:59.964389445\n2011-09-27 00:00:00.064389445\n"
              "2011-09-27 00:00:00.164389\n");
    for (const char* packet : {"0000000000", "0000000002"}) {
      writeText(
          file("oxts/data") / (std::string(packet) + ".txt"),
          "49.01 8.43 112.8 0.03 0.006 -0.9 1 2 3 4 5 0.5 -0.25 9.75 6 7 8 0.01 -0.02 0.125 9 "
          "10 11 0.5 0.1 4 11 6 6 6\n");
    }
    writeText(fs::path(folder()).parent_path() / "calib_imu_to_velo.txt",
              "calib_time: 25-May-2012 16:47:16\nR: 1 0 0 0 1 0 0 0 1\nT: -0.8 0.3 -0.7\n");
    writeText(fs::path(folder()).parent_path() / "calib_velo_to_cam.txt",
              "R: 0 -1 0 0 0 -1 1 0 0\nT: 0 0 -0.25\ndelta_f: 0 0\n");
    writeText(fs::path(folder()).parent_path() / "calib_cam_to_cam.txt",
              "R_rect_00: 1 0 0 0 1 0 0 0 1\n");
  }

  void expectImuRefused(const std::string& word) const {
    try {
      StereoDataset::open(folder()).readImu();
      ADD_FAILURE() << "was not refused: " << word;
    } catch (const InputError& error) {
      EXPECT_NE(std::string(error.what()).find(word), std::string::npos) << error.what();
    }
  }
};

TEST_F(OxtsTest, GivesRatesAndAccelerationsInTheAxesOfTheImu) {
  const std::optional<ImuData> imu = StereoDataset::open(folder()).readImu();
  ASSERT_TRUE(imu);
  ASSERT_EQ(imu->samples.size(), 2U) << "a packet is missing, as in some drives";
  EXPECT_EQ(imu->samples[0].angular_velocity, Eigen::Vector3d(0.01, -0.02, 0.125));
  EXPECT_EQ(imu->samples[0].acceleration, Eigen::Vector3d(0.5, -0.25, 9.75));
  // Without the times of the images the first packet is of the first one.
  EXPECT_EQ(imu->samples[0].stamp_ns, 0);
  EXPECT_EQ(imu->samples[1].stamp_ns, 199999555);
  // The camera looks ahead: its z is the x of the IMU, its y points down.
  EXPECT_TRUE((imu->T_imu_camera.linear() * Eigen::Vector3d::UnitZ())
                  .isApprox(Eigen::Vector3d::UnitX(), 1e-12));
  EXPECT_TRUE((imu->T_imu_camera.linear() * Eigen::Vector3d::UnitY())
                  .isApprox(-Eigen::Vector3d::UnitZ(), 1e-12));
  // By hand: the camera is at (0.25, 0, 0) of the velodyne, that at (0.8, -0.3, 0.7) of the IMU.
  EXPECT_TRUE(imu->T_imu_camera.translation().isApprox(Eigen::Vector3d(1.05, -0.3, 0.7), 1e-12))
      << imu->T_imu_camera.translation().transpose();
}

TEST_F(OxtsTest, TimesOfTheImagesAreUsed) {
  writeText(file("image_0/timestamps.txt"), "2011-09-26 23:59:59.954389445\n");
  const std::optional<ImuData> imu = StereoDataset::open(folder()).readImu();
  ASSERT_TRUE(imu);
  EXPECT_EQ(imu->samples[0].stamp_ns, 10000000);
}

TEST_F(OxtsTest, DamagedFilesAreRefused) {
  writeText(file("oxts/data/0000000002.txt"), "1 2 3\n");
  expectImuRefused("0000000002.txt");
  fs::remove_all(file("oxts/data"));
  expectImuRefused("no packet");
  writeText(file("oxts/timestamps.txt"), "yesterday\n");
  expectImuRefused("yesterday");
  fs::remove(fs::path(folder()).parent_path() / "calib_velo_to_cam.txt");
  expectImuRefused("calib_velo_to_cam.txt");
  EXPECT_EQ(StereoDataset::open(folder()).size(), 3U) << "the images are none the worse for it";
}

// --- EuRoC ------------------------------------------------------------------------------------

class EurocDatasetTest : public DatasetTest {
 protected:
  void SetUp() override {
    DatasetTest::SetUp();
    writeCamera("cam0", 10);
    writeCamera("cam1", 20);
    writeSensor("cam0", "0.0");
    writeSensor("cam1", "0.1");
  }

  void writeCamera(const std::string& camera, int value) const {
    std::string index = "#timestamp [ns],filename\r\n";
    for (int i = 0; i < 3; ++i) {
      const std::string stamp = "140363658476355558" + std::to_string(i);
      index += stamp + "," + stamp + ".png\r\n";
      writeImage(file("mav0/" + camera + "/data/" + stamp + ".png"), value + i);
    }
    writeText(file("mav0/" + camera + "/data.csv"), index);
  }

  /// Body: x right, y forward, z up of cameras that look along y.
  void writeSensor(const std::string& camera, const std::string& x_m,
                   const std::string& model = "radial-tangential") const {
    writeText(file("mav0/" + camera + "/sensor.yaml"),
              "sensor_type: camera\nT_BS:\n  cols: 4\n  rows: 4\n  data: [1, 0, 0, " + x_m +
                  ",\n    0, 0, 1, 0,\n    0, -1, 0, 0,\n    0, 0, 0, 1]\n"
                  "resolution: [64, 48]\nintrinsics: [50, 51, 32, 24]\ndistortion_model: " +
                  model + "\ndistortion_coefficients: [0.01, 0.002, 0.0, 0.0]\n");
  }

  void writeGroundTruth(const std::string& rows) const {
    writeText(file("mav0/state_groundtruth_estimate0/data.csv"), "#timestamp, p, q\n" + rows);
  }
};

TEST_F(EurocDatasetTest, ReadsIndexCalibrationAndImages) {
  const StereoDataset dataset = StereoDataset::open(folder());
  ASSERT_EQ(dataset.size(), 3U);
  EXPECT_EQ(dataset.frame(2).stamp_ns, 1403636584763555582);
  EXPECT_TRUE(dataset.needsRectification());
  const CameraCalibration& left = dataset.calibration().left;
  EXPECT_EQ(left.distortion_model, "plumb_bob");
  EXPECT_EQ(left.D, (std::vector<double>{0.01, 0.002, 0.0, 0.0, 0.0}));
  EXPECT_EQ(left.K(1, 1), 51.0);
  EXPECT_NEAR(rectifiedCamera(dataset.calibration()).baseline_m, 0.1, 1e-12);
  EXPECT_EQ(dataset.load(1).right.at<std::uint8_t>(0, 0), 21);
}

TEST_F(EurocDatasetTest, TakesTheInnerFolderToo) {
  EXPECT_EQ(StereoDataset::open(file("mav0").string()).size(), 3U);
}

TEST_F(EurocDatasetTest, PairsByEqualStamps) {
  writeText(file("mav0/cam1/data.csv"),
            "#timestamp [ns],filename\n1403636584763555581,1403636584763555581.png\n"
            "1403636584763555583,gone.png\n");
  const StereoDataset dataset = StereoDataset::open(folder());
  ASSERT_EQ(dataset.size(), 1U);
  EXPECT_EQ(dataset.frame(0).stamp_ns, 1403636584763555581);
  EXPECT_EQ(dataset.load(0).left.at<std::uint8_t>(0, 0), 11);
}

TEST_F(EurocDatasetTest, NamesOfColumnsNeedNotBeAComment) {
  for (const char* camera : {"cam0", "cam1"}) {
    writeText(file("mav0/" + std::string(camera) + "/data.csv"),
              "timestamp,filename\n1403636584763555580,1403636584763555580.png\n");
  }
  EXPECT_EQ(StereoDataset::open(folder()).size(), 1U);
}

TEST_F(EurocDatasetTest, GroundTruthIsOfTheLeftCamera) {
  writeSensor("cam0", "-0.5");
  // The body is turned by 90 degrees about z: its x axis points along y.
  writeGroundTruth("1403636584763555580,1,2,3,0.70710678118,0,0,0.70710678118,0,0,0\r\n");
  const StereoDataset dataset = StereoDataset::open(folder());
  ASSERT_EQ(dataset.groundTruth().size(), 1U);
  const StampedPose& pose = dataset.groundTruth()[0];
  EXPECT_EQ(pose.stamp_ns, 1403636584763555580);
  EXPECT_TRUE(pose.T_world_camera.translation().isApprox(Eigen::Vector3d(1.0, 1.5, 3.0), 1e-9));
  const Eigen::Vector3d forward = pose.T_world_camera.linear().col(2);
  EXPECT_TRUE(forward.isApprox(Eigen::Vector3d(-1, 0, 0), 1e-9)) << forward.transpose();
  EXPECT_EQ(dataset.T_body_camera()->translation().x(), -0.5);
}

TEST_F(EurocDatasetTest, TakesFisheyeCameras) {
  writeSensor("cam0", "0.0", "equidistant");
  writeSensor("cam1", "0.1", "equidistant");
  const StereoDataset dataset = StereoDataset::open(folder());
  EXPECT_EQ(dataset.calibration().left.distortion_model, "equidistant");
  EXPECT_NEAR(rectifiedCamera(dataset.calibration()).baseline_m, 0.1, 1e-12);
}

TEST_F(EurocDatasetTest, RefusesMissingImages) {
  fs::remove(file("mav0/cam1/data/1403636584763555581.png"));
  expectRefused({"is truncated", "1 of 6", "cam1/data/1403636584763555581.png"});
}

TEST_F(EurocDatasetTest, RefusesAFolderInPlaceOfAnImage) {
  fs::remove(file("mav0/cam1/data/1403636584763555581.png"));
  fs::create_directory(file("mav0/cam1/data/1403636584763555581.png"));
  expectRefused({"is truncated", "1 of 6", "cam1/data/1403636584763555581.png"});
}

TEST_F(EurocDatasetTest, RefusesMissingRightCamera) {
  fs::remove_all(file("mav0/cam1"));
  expectRefused({"cam1/data.csv", "is missing"});
}

TEST_F(EurocDatasetTest, RefusesEmptyIndex) {
  writeText(file("mav0/cam0/data.csv"), "#timestamp [ns],filename\n");
  expectRefused({"cam0/data.csv", "names no image"});
}

TEST_F(EurocDatasetTest, RefusesIndexWithoutStamps) {
  writeText(file("mav0/cam0/data.csv"), "yesterday,a.png\n");
  expectRefused({"cam0/data.csv", "'yesterday,a.png'"});
}

TEST_F(EurocDatasetTest, RefusesCamerasThatAreNotSynchronised) {
  writeText(file("mav0/cam1/data.csv"), "1403636584763555999,a.png\n");
  expectRefused({"no stamp of cam0/data.csv occurs in cam1/data.csv"});
}

TEST_F(EurocDatasetTest, RefusesMissingCalibration) {
  fs::remove(file("mav0/cam1/sensor.yaml"));
  expectRefused({"cam1/sensor.yaml", "is missing"});
}

TEST_F(EurocDatasetTest, RefusesCalibrationThatIsNotYaml) {
  writeText(file("mav0/cam0/sensor.yaml"), "intrinsics: [1, 2");
  expectRefused({"cam0/sensor.yaml", "unusable"});
}

TEST_F(EurocDatasetTest, RefusesCalibrationWithoutIntrinsics) {
  writeText(file("mav0/cam0/sensor.yaml"), "resolution: [64, 48]\n");
  expectRefused({"cam0/sensor.yaml", "intrinsics"});
}

TEST_F(EurocDatasetTest, RefusesUnknownDistortion) {
  writeSensor("cam0", "0.0", "omni");
  expectRefused({"cam0/sensor.yaml", "'omni'", "equidistant"});
}

TEST_F(EurocDatasetTest, RefusesSwappedCameras) {
  writeSensor("cam1", "-0.1");
  expectRefused({"sensor.yaml", "baseline of -0.1", "swap"});
}

TEST_F(EurocDatasetTest, RefusesCamerasAtOnePosition) {
  writeSensor("cam1", "0.0");
  expectRefused({"sensor.yaml", "0 m apart"});
}

TEST_F(EurocDatasetTest, RefusesGroundTruthWithoutOrientation) {
  writeGroundTruth("1403636584763555580,1,2,3\n");
  expectRefused({"state_groundtruth_estimate0/data.csv", "unit quaternion"});
}

// --- Writing ----------------------------------------------------------------------------------

class DatasetWriterTest : public DatasetTest {
 protected:
  void SetUp() override {
    DatasetTest::SetUp();
    fs::create_directories(folder());
    for (CameraCalibration* camera : {&calibration_.left, &calibration_.right}) {
      camera->width = kWidth;
      camera->height = kHeight;
      camera->K << 50.1, 0.0, 32.0 / 3.0, 0.0, 51.0, 24.0, 0.0, 0.0, 1.0;
      camera->D = {-0.01, 0.1 / 3.0, 0.001, 0.0, 0.0};
      camera->P.leftCols<3>() = camera->K;
      camera->P(1, 1) = camera->P(0, 0);
    }
    calibration_.right.P(0, 3) = -20.0 / 3.0;
  }

  /// Writes frame i, which has its number in the images' grey and in the pose.
  void add(int i, DatasetWriter* writer) {
    const cv::Size size(kWidth, kHeight);
    StereoImages images;
    images.left = cv::Mat(size, CV_8UC1, cv::Scalar(10 + i));
    images.right = cv::Mat(size, CV_8UC1, cv::Scalar(20 + i));
    images.stamp_ns = 33333333 * static_cast<std::int64_t>(i);
    Eigen::Isometry3d pose(Eigen::AngleAxisd(0.1 * i, Eigen::Vector3d::UnitY()));
    pose.translation() << i, 0.5, -1.0 / 3.0;
    writer->add(images, pose);
  }

  StereoDataset writeAndRead(DatasetLayout layout) {
    DatasetWriter writer(folder(), layout, calibration_, 30.0);
    for (int i = 0; i < 3; ++i) add(i, &writer);
    writer.finish();
    return StereoDataset::open(folder());
  }

  static void expectFrames(const StereoDataset& dataset) {
    ASSERT_EQ(dataset.size(), 3U);
    ASSERT_EQ(dataset.groundTruth().size(), 3U);
    EXPECT_EQ(dataset.frame(2).stamp_ns, 66666666);
    EXPECT_EQ(dataset.load(1).left.at<std::uint8_t>(5, 5), 11);
    EXPECT_EQ(dataset.load(2).right.at<std::uint8_t>(5, 5), 22);
    const StampedPose& pose = dataset.groundTruth()[2];
    EXPECT_EQ(pose.stamp_ns, 66666666);
    EXPECT_TRUE(
        pose.T_world_camera.translation().isApprox(Eigen::Vector3d(2, 0.5, -1.0 / 3), 1e-8));
    EXPECT_NEAR(Eigen::AngleAxisd(pose.T_world_camera.linear()).angle(), 0.2, 1e-8);
  }

  StereoCalibration calibration_;
};

TEST_F(DatasetWriterTest, KittiIsReadBackAsItWas) {
  const StereoDataset dataset = writeAndRead(DatasetLayout::kKitti);
  expectFrames(dataset);
  EXPECT_FALSE(dataset.needsRectification());
  EXPECT_EQ(dataset.calibration().left.P, calibration_.left.P);
  EXPECT_EQ(dataset.calibration().right.P, calibration_.right.P);
}

TEST_F(DatasetWriterTest, EurocIsReadBackAsItWas) {
  Eigen::Isometry3d T_right_left(Eigen::AngleAxisd(0.02, Eigen::Vector3d(1, 2, 3).normalized()));
  T_right_left.translation() << -0.11, 0.001, 0.002;
  calibration_ = rectifyCalibration(calibration_, T_right_left);
  EXPECT_TRUE(poseOfRightInLeft(calibration_).isApprox(T_right_left.inverse(), 1e-9));

  const StereoDataset dataset = writeAndRead(DatasetLayout::kEuroc);
  expectFrames(dataset);
  EXPECT_TRUE(dataset.needsRectification());
  EXPECT_TRUE(dataset.T_body_camera()->isApprox(Eigen::Isometry3d::Identity()));
  EXPECT_EQ(dataset.calibration().left.K, calibration_.left.K);
  EXPECT_EQ(dataset.calibration().left.D, calibration_.left.D);
  EXPECT_EQ(dataset.calibration().left.distortion_model, "plumb_bob");
  EXPECT_TRUE(dataset.calibration().right.R.isApprox(calibration_.right.R, 1e-12));
  EXPECT_TRUE(dataset.calibration().right.P.isApprox(calibration_.right.P, 1e-12));
}

TEST_F(DatasetWriterTest, WritesFisheyeCameras) {
  for (CameraCalibration* camera : {&calibration_.left, &calibration_.right}) {
    camera->distortion_model = "equidistant";
    camera->D.resize(4);
  }
  const StereoDataset dataset = writeAndRead(DatasetLayout::kEuroc);
  EXPECT_EQ(dataset.calibration().right.distortion_model, "equidistant");
  EXPECT_EQ(dataset.calibration().right.D, calibration_.right.D);
}

TEST_F(DatasetWriterTest, NamesTheFileThatCannotBeWritten) {
  writeText(file("mav0"), "a file where a folder must be");
  EXPECT_THROW(DatasetWriter(folder(), DatasetLayout::kEuroc, calibration_, 30.0), InputError);
  DatasetWriter writer(folder(), DatasetLayout::kKitti, calibration_, 30.0);
  fs::remove_all(file("image_1"));
  EXPECT_THROW(add(0, &writer), InputError);
}

}  // namespace
}  // namespace point_line_odometry
