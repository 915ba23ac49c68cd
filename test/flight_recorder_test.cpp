/// The frame ring of the flight recorder and the files written from it, without a node.

#include <gtest/gtest.h>
#include <sys/resource.h>
#include <unistd.h>
#include <yaml-cpp/yaml.h>

#include <boost/crc.hpp>
#include <boost/make_shared.hpp>
#include <csignal>
#include <filesystem>
#include <fstream>
#include <functional>
#include <iterator>
#include <set>

#include "common/input_error.h"
#include "common/recording_format.h"
#include "common/retired_parameters.h"
#include "point_line_odometry/version.h"
#include "ros/camera_messages.h"
#include "ros/conversions.h"
#include "ros/frame_ring.h"
#include "ros/recording_writer.h"
#include "synthetic_scene.h"
#include "tools/bag_source.h"
#include "tools/recorded_run.h"
#include "tools/recording_replay.h"

namespace point_line_odometry {
namespace {

namespace fs = std::filesystem;

sensor_msgs::CameraInfoConstPtr cameraInfo(double baseline_m, const std_msgs::Header& header) {
  const StereoCamera camera = synthetic::roomCamera();
  const auto info = boost::make_shared<sensor_msgs::CameraInfo>();
  info->header = header;
  info->width = static_cast<std::uint32_t>(camera.width);
  info->height = static_cast<std::uint32_t>(camera.height);
  info->P = {camera.fx, 0, camera.cx, -camera.fx * baseline_m, 0, camera.fy, camera.cy, 0, 0,
             0,         1, 0};
  return info;
}

StereoMessages messagesOf(const StereoImages& images) {
  ros::Time stamp;
  stamp.fromNSec(static_cast<std::uint64_t>(images.stamp_ns));
  const std_msgs::Header header = makeHeader("camera", stamp);
  return {toImageMessage(images.left, header), toImageMessage(images.right, header),
          cameraInfo(0.0, header), cameraInfo(synthetic::roomCamera().baseline_m, header)};
}

class FlightRecorderTest : public ::testing::Test {
 protected:
  void SetUp() override {
    std::string name = (fs::temp_directory_path() / "point_line_recorder_XXXXXX").string();
    ASSERT_NE(mkdtemp(name.data()), nullptr);
    root_ = name;
    target_.name_space = "/stereo";
    target_.node = "/stereo/odometry";
    target_.parameters.recorder.folder = root_.string();
  }
  void TearDown() override { fs::remove_all(root_); }

  /// Processes frames [begin, end) of the room and adds them to the ring.
  void drive(int begin, int end, FrameProcessor* processor, FrameRing* ring) {
    processor->observeStarts([this, ring](const FrameStart& start) {
      ring->prepare(start);
      parameters_ = std::make_shared<const Parameters>(start.odometry.parameters());
    });
    for (int k = begin; k < end; ++k) {
      const StereoMessages messages = messagesOf(synthetic::frame(k));
      last_left_ = messages.left;
      if (imu_rate_rad_s_ > 0.0) addImu(k, processor);
      const ProcessedFrame frame = processor->process(messages, Eigen::Isometry3d::Identity());
      uses_.push_back(frame.result.prior.use);
      ring->add({messages, toOdometry(frame, {"odom", "base_link"}), frame.result.state,
                 frame.result.reason, frame.result.T_odom_camera, frame.T_base_camera, parameters_,
                 frame.masks.left, frame.masks.right, frame.prior, frame.tilt});
    }
  }

  /// The samples of the interval until a frame: a gyroscope in the axes of the base.
  void addImu(int k, FrameProcessor* processor) const {
    for (int i = 0; i < 11; ++i) {
      ImuSample sample;
      sample.stamp_ns = synthetic::frame(k).stamp_ns + (i - 9) * synthetic::kPeriodNs / 10;
      sample.angular_velocity = {0.02, -imu_rate_rad_s_, 0.03};
      processor->priorSources().addImu(sample, Eigen::Isometry3d::Identity());
    }
  }

  /// A recording of `frames` frames from the start.
  Recording record(int frames) {
    FrameProcessor processor{AllParameters()};
    FrameRing ring(100, 1000000000);
    drive(0, frames, &processor, &ring);
    return ring.recording();
  }

  /// Replays a recording.
  /// What reading the yaml of a recording is refused with; empty if it is not.
  std::string refusalOfReplay(const fs::path& yaml) {
    try {
      replay(yaml);
    } catch (const InputError& error) {
      return error.what();
    }
    return "";
  }

  RecordingComparison replay(const fs::path& yaml, const std::optional<Parameters>& instead = {}) {
    RecordingReplay replay(readRecording(yaml.string()));
    const std::unique_ptr<StereoSource> source =
        openBag({replay.run().bag, replay.run().topics, replay.run().max_interval_ns,
                 use_masks_ && replay.run().has_masks});
    StereoOdometry odometry(rectifiedCamera(source->calibration()), replay.run().parameters);
    replay.begin(instead, &odometry);
    while (const std::optional<StereoImages> images = source->next()) {
      replay.prepare(images->stamp_ns, &odometry);
      const std::optional<MotionPrior> prior = replay.priorOf(images->stamp_ns);
      replay.compare(odometry.process(*images, prior ? &*prior : nullptr));
    }
    return replay.comparison();
  }

  std::set<std::string> files() const {
    std::set<std::string> names;
    for (const auto& entry : fs::recursive_directory_iterator(root_))
      if (entry.is_regular_file()) names.insert(entry.path().filename().string());
    return names;
  }

  fs::path root_;
  RecordingTarget target_;
  std::shared_ptr<const Parameters> parameters_;
  sensor_msgs::ImageConstPtr last_left_;
  bool use_masks_ = true;
  double imu_rate_rad_s_ = 0.0;  // 0: no IMU
  std::vector<PriorUse> uses_;   // of the frames
};

/// Also those frames whose mask did not come.
TEST_F(FlightRecorderTest, MasksAreRecordedAndReplayed) {
  AllParameters parameters;
  parameters.node.mask_images = "left";
  FrameProcessor processor(parameters);
  FrameRing ring(100, 1000000000);
  processor.observeStarts([&](const FrameStart& start) {
    ring.prepare(start);
    parameters_ = std::make_shared<const Parameters>(start.odometry.parameters());
  });
  int num_masked = 0;
  for (int k = 0; k < synthetic::kFrames; ++k) {
    StereoMessages messages = messagesOf(synthetic::frame(k));
    cv::Mat mask(synthetic::frame(k).left.size(), CV_8UC1, cv::Scalar(255));
    mask.colRange(100 + 10 * k, 200 + 10 * k) = cv::Scalar(0);
    if (k != 3) messages.left_mask = toImageMessage(mask, messages.left->header);
    const ProcessedFrame frame = processor.process(messages, Eigen::Isometry3d::Identity());
    num_masked += frame.masks.left.empty() ? 0 : 1;
    ring.add({messages, toOdometry(frame, {"odom", "base_link"}), frame.result.state,
              frame.result.reason, frame.result.T_odom_camera, frame.T_base_camera, parameters_,
              frame.masks.left, frame.masks.right});
  }
  EXPECT_EQ(num_masked, synthetic::kFrames - 1);
  const RecordingFiles written = writeRecording(ring.recording(), target_, "asked");
  EXPECT_TRUE(readRecording(written.yaml.string()).has_masks);
  RecordingComparison comparison = replay(written.yaml);
  EXPECT_EQ(comparison.frames, static_cast<std::size_t>(synthetic::kFrames));
  EXPECT_EQ(comparison.equal, comparison.frames);
  use_masks_ = false;
  comparison = replay(written.yaml);
  EXPECT_LT(comparison.equal, comparison.frames) << "the masks make no difference";
}

TEST_F(FlightRecorderTest, AMaskThatDoesNotChangeTakesMemoryOnce) {
  FrameProcessor processor{AllParameters()};
  const cv::Mat mask(1, 4000, CV_8UC1, cv::Scalar(0));
  const auto framesKept = [&](bool same) {
    FrameRing ring(1000, 2 * 10000);  // half: 10000 bytes
    processor.observeStarts([&](const FrameStart& start) { ring.prepare(start); });
    for (int k = 0; k < synthetic::kFrames; ++k) {
      processor.process(messagesOf(synthetic::frame(k)), Eigen::Isometry3d::Identity());
      RecordedFrame frame;
      frame.messages = messagesOf(synthetic::frame(k));
      const auto empty = boost::make_shared<sensor_msgs::Image>();
      frame.messages.left = frame.messages.right = empty;
      frame.left_mask = same ? mask : mask.clone();
      ring.add(frame);
    }
    processor.reset(Eigen::Isometry3d::Identity());
    return ring.recording().frames.size();
  };
  EXPECT_EQ(framesKept(true), static_cast<std::size_t>(synthetic::kFrames));
  EXPECT_LT(framesKept(false), static_cast<std::size_t>(synthetic::kFrames));
}

// --- The ring

TEST_F(FlightRecorderTest, HasBetweenHalfAndAllOfItsFramesAndSharesTheImages) {
  FrameProcessor processor{AllParameters()};
  FrameRing ring(4, 1000000000);
  EXPECT_EQ(ring.recording().start, nullptr);
  const std::vector<std::size_t> expected{1, 2, 3, 4, 3, 4, 3, 4};
  for (int k = 0; k < synthetic::kFrames; ++k) {
    drive(k, k + 1, &processor, &ring);
    const Recording recording = ring.recording();
    ASSERT_EQ(recording.frames.size(), expected[k]) << k;
    ASSERT_NE(recording.start, nullptr);
    const auto stamp_ns = (k + 1) * synthetic::kPeriodNs;
    EXPECT_EQ(toNanoseconds(recording.frames.back().odometry.header.stamp), stamp_ns);
    EXPECT_EQ(recording.frames.back().messages.left, last_left_) << "the image was copied";
  }
}

TEST_F(FlightRecorderTest, ImagesBeyondTheMemoryLimitAreDiscarded) {
  const StereoCamera camera = synthetic::roomCamera();
  const auto pair_bytes = static_cast<std::size_t>(2 * camera.width * camera.height);
  FrameProcessor processor{AllParameters()};
  FrameRing ring(1000, 4 * pair_bytes);
  drive(0, synthetic::kFrames, &processor, &ring);
  EXPECT_EQ(ring.recording().frames.size(), 4U);
}

TEST_F(FlightRecorderTest, AResetOrAnotherCalibrationStartsANewRecording) {
  FrameProcessor processor{AllParameters()};
  FrameRing ring(100, 1000000000);
  drive(0, 3, &processor, &ring);
  Eigen::Isometry3d elsewhere = Eigen::Isometry3d::Identity();
  elsewhere.translation().x() = 7.0;
  processor.reset(elsewhere);
  drive(3, 5, &processor, &ring);
  EXPECT_EQ(ring.recording().frames.size(), 2U);
  EXPECT_EQ(ring.recording().start->T_odom_base.translation().x(), 7.0);

  // Another calibration is accepted once three frames in a row have it.
  const auto processWithOther = [&](int i) {
    StereoMessages messages = messagesOf(synthetic::frame(i));
    messages.right_info = cameraInfo(0.3, messages.left->header);
    processor.process(messages, Eigen::Isometry3d::Identity());
  };
  EXPECT_THROW(processWithOther(5), std::exception);
  EXPECT_THROW(processWithOther(6), std::exception);
  EXPECT_EQ(ring.recording().frames.size(), 2U);
  processWithOther(7);
  EXPECT_EQ(ring.recording().frames.size(), 0U);
  ASSERT_NE(ring.recording().start, nullptr);
  EXPECT_NEAR(ring.recording().start->T_odom_base.translation().x(), 7.0, 1.0);
}

TEST_F(FlightRecorderTest, OtherParametersDoNotStartANewRecording) {
  FrameProcessor processor{AllParameters()};
  FrameRing ring(100, 1000000000);
  drive(0, 3, &processor, &ring);
  Parameters fewer;
  fewer.lines.max_count = 40;
  processor.setParameters(fewer);
  drive(3, 6, &processor, &ring);
  const Recording recording = ring.recording();
  ASSERT_EQ(recording.frames.size(), 6U);
  EXPECT_EQ(recording.frames[2].parameters->lines.max_count, 300);
  EXPECT_EQ(recording.frames[3].parameters->lines.max_count, 40);

  const RecordingFiles files = writeRecording(recording, target_, "asked");
  const RecordingComparison comparison = replay(files.yaml);
  EXPECT_EQ(comparison.frames, 6U);
  EXPECT_EQ(comparison.equal, 6U);
  EXPECT_LT(replay(files.yaml, Parameters()).equal, 6U) << "the change makes no difference";
}

// --- The files

TEST_F(FlightRecorderTest, FilesContainAllThatAReplayNeeds) {
  FrameProcessor processor{AllParameters()};
  FrameRing ring(6, 1000000000);
  drive(0, synthetic::kFrames, &processor, &ring);
  const Recording recording = ring.recording();
  ASSERT_EQ(recording.frames.size(), 5U);
  const RecordingFiles files = writeRecording(recording, target_, "lost");
  EXPECT_EQ(files.yaml.parent_path(), root_ / "stereo_odometry");
  const RecordingComparison comparison = replay(files.yaml);
  EXPECT_EQ(comparison.frames, 5U);
  EXPECT_EQ(comparison.equal, 5U);
  EXPECT_EQ(comparison.max_distance_m, 0.0);

  const YAML::Node yaml = YAML::LoadFile(files.yaml.string());
  EXPECT_EQ(yaml["version"].as<std::string>(), version());
  EXPECT_EQ(yaml["format"].as<int>(), kRecordingFormat);
  EXPECT_EQ(yaml["reason"].as<std::string>(), "lost");
  EXPECT_EQ(yaml["left_topic"].as<std::string>(), "/stereo/left/image_rect");
  EXPECT_EQ(yaml["parameters"].size(), parameterTexts({}).size());
  EXPECT_EQ(yaml["T_odom_base"].as<std::vector<double>>()[3],
            recording.start->T_odom_base.translation().x());
  EXPECT_EQ(yaml["frames"].size(), 5U);
  EXPECT_EQ(yaml["frames"][4]["state"].as<std::string>(), "ok");
}

/// The node's gyroscope is in use, and its priors are in the recording: the replay gives the same
/// bits without the samples.
TEST_F(FlightRecorderTest, MotionPriorsAreReplayed) {
  AllParameters parameters;
  parameters.core.imu.enabled = true;
  FrameProcessor processor(parameters);
  FrameRing ring(100, 1000000000);
  imu_rate_rad_s_ = 0.12;  // that of the camera
  drive(0, synthetic::kFrames, &processor, &ring);
  EXPECT_EQ(uses_.front(), PriorUse::kNone);
  for (std::size_t k = 1; k < uses_.size(); ++k) EXPECT_EQ(uses_[k], PriorUse::kUsed) << k;
  const RecordingFiles files = writeRecording(ring.recording(), target_, "asked");
  const RecordingComparison comparison = replay(files.yaml);
  EXPECT_EQ(comparison.equal, static_cast<std::size_t>(synthetic::kFrames));
  const RecordedRun run = readRecording(files.yaml.string());
  ASSERT_TRUE(run.frames[3].prior);
  EXPECT_EQ(run.frames[3].prior->from_ns, run.frames[2].stamp_ns);
}

TEST_F(FlightRecorderTest, EveryDigitOfTheParametersIsKept) {
  AllParameters parameters;
  parameters.core.motion.huber_delta = 1.0 / 3.0 + 1.0;
  parameters.core.motion.residual_images = "left";
  parameters.core.matching.refine_subpixel = false;
  FrameProcessor processor(parameters);
  FrameRing ring(100, 1000000000);
  drive(0, 2, &processor, &ring);
  const RecordingFiles files = writeRecording(ring.recording(), target_, "asked");
  const Parameters read = readRecording(files.yaml.string()).parameters;
  EXPECT_EQ(read.motion.huber_delta, parameters.core.motion.huber_delta);
  EXPECT_TRUE(changedParameters(parameters.core, read).empty());
}

/// Of version 0.1.0, which wrote all of its parameters, also with a frame that changed them.
TEST_F(FlightRecorderTest, RecordingsThatNameRetiredParametersAreReplayed) {
  FrameProcessor processor{AllParameters()};
  FrameRing ring(6, 1000000000);
  drive(0, synthetic::kFrames, &processor, &ring);
  const RecordingFiles files = writeRecording(ring.recording(), target_, "lost");
  YAML::Node yaml = YAML::LoadFile(files.yaml.string());
  for (const RetiredParameter& each : kRetiredParameters)
    yaml["parameters"][each.name] = each.value;
  yaml["frames"][1]["parameters"]["window/max_iterations"] = 7;
  std::ofstream(files.yaml) << yaml;
  EXPECT_EQ(readRecording(files.yaml.string()).warnings.size(), kRetiredParameters.size());
  const RecordingComparison comparison = replay(files.yaml);
  EXPECT_EQ(comparison.frames, 5U);
  EXPECT_EQ(comparison.equal, 5U);
}

TEST_F(FlightRecorderTest, KeepsTheNewestOfEachReasonAndRemovesNothingElse) {
  const Recording recording = record(1);
  target_.parameters.recorder.max_files = 2;
  fs::create_directories(target_.folder());
  std::ofstream(target_.folder() / "mine-lost.bag") << "not a recording's name";
  const RecordingFiles asked = writeRecording(recording, target_, "asked");
  std::vector<RecordingFiles> lost;
  for (int i = 0; i < 4; ++i) {
    lost.push_back(writeRecording(recording, target_, "lost"));
    usleep(2000);  // names differ in the millisecond
  }
  for (int i = 0; i < 4; ++i) {
    for (const fs::path& file : {lost[i].bag, lost[i].yaml, lost[i].state})
      EXPECT_EQ(fs::exists(file), i >= 2) << file;
  }
  EXPECT_TRUE(fs::exists(asked.yaml));
  EXPECT_TRUE(fs::exists(target_.folder() / "mine-lost.bag"));
  EXPECT_EQ(files().size(), 3 * 3 + 1U);
}

TEST_F(FlightRecorderTest, KeepsTheRecordingThatAClockSetBackNamesTheOldest) {
  target_.parameters.recorder.max_files = 2;
  fs::create_directories(target_.folder());
  for (const char* name : {"2126-01-01-00-00-00-000-lost.bag", "2126-01-01-00-00-01-000-lost.bag",
                           "2126-01-01-00-00-02-000-lost.bag.part"})
    std::ofstream(target_.folder() / name) << "of another run";
  const RecordingFiles lost = writeRecording(record(1), target_, "lost");
  EXPECT_TRUE(fs::exists(lost.bag) && fs::exists(lost.yaml) && fs::exists(lost.state));
  EXPECT_FALSE(fs::exists(target_.folder() / "2126-01-01-00-00-00-000-lost.bag"));
  EXPECT_TRUE(fs::exists(target_.folder() / "2126-01-01-00-00-01-000-lost.bag"));
  EXPECT_EQ(files().size(), 4U) << "what an interrupted one has left is removed";
}

TEST_F(FlightRecorderTest, NothingIsLeftWhenTheDiskIsFull) {
  const Recording recording = record(2);
  const auto old_handler = std::signal(SIGXFSZ, SIG_IGN);
  rlimit old_limit{};
  getrlimit(RLIMIT_FSIZE, &old_limit);
  rlimit limit = old_limit;
  limit.rlim_cur = 100000;
  setrlimit(RLIMIT_FSIZE, &limit);
  try {
    writeRecording(recording, target_, "lost");
    ADD_FAILURE() << "was not refused";
  } catch (const std::runtime_error& error) {
    EXPECT_NE(std::string(error.what()).find("make room on disk"), std::string::npos)
        << error.what();
  }
  setrlimit(RLIMIT_FSIZE, &old_limit);
  std::signal(SIGXFSZ, old_handler);
  EXPECT_TRUE(files().empty());
  EXPECT_NO_THROW(writeRecording(recording, target_, "lost"));
}

TEST_F(FlightRecorderTest, WhatCannotBeWrittenIsRefused) {
  EXPECT_THROW(writeRecording(Recording(), target_, "asked"), std::runtime_error);
  std::ofstream(root_ / "file") << "no folder";
  target_.parameters.recorder.folder = (root_ / "file").string();
  EXPECT_THROW(writeRecording(record(1), target_, "asked"), std::runtime_error);
}

TEST_F(FlightRecorderTest, FolderIsInRosHomeUnlessItIsAbsolute) {
  setenv("ROS_HOME", "/some/home", 1);
  target_.parameters.recorder.folder = "recordings";
  EXPECT_EQ(target_.folder(), "/some/home/recordings/stereo_odometry");
  target_.parameters.recorder.folder = "/data";
  EXPECT_EQ(target_.folder(), "/data/stereo_odometry");
  unsetenv("ROS_HOME");
  setenv("HOME", "/home/robot", 1);
  target_.parameters.recorder.folder = "recordings";
  EXPECT_EQ(target_.folder(), "/home/robot/.ros/recordings/stereo_odometry");
}

TEST_F(FlightRecorderTest, RecordingsOfOtherVersionsAreRefusedByName) {
  const RecordingFiles files = writeRecording(record(2), target_, "asked");
  const YAML::Node original = YAML::LoadFile(files.yaml.string());
  const auto refusal_of = [&](const std::function<void(YAML::Node*)>& change) {
    YAML::Node yaml = YAML::Clone(original);
    change(&yaml);
    std::ofstream(files.yaml) << yaml;
    return refusalOfReplay(files.yaml);
  };
  EXPECT_EQ(refusal_of([](YAML::Node* yaml) { yaml->remove("format"); }), "") << "of 0.1.0";
  const std::string newer = refusal_of([](YAML::Node* yaml) {
    (*yaml)["format"] = kRecordingFormat + 1;
    (*yaml)["version"] = "7.8.9";
  });
  for (const std::string& word :
       {std::string("format 2"), std::string("7.8.9"), "version " + std::string(version())})
    EXPECT_NE(newer.find(word), std::string::npos) << word << " is not in: " << newer;
  EXPECT_NE(refusal_of([](YAML::Node* yaml) { (*yaml)["format"] = 0; }), "");
  EXPECT_NE(refusal_of([](YAML::Node* yaml) { (*yaml)["format"] = "new"; }), "");

  std::fstream state(files.state, std::ios::in | std::ios::out | std::ios::binary);
  std::string bytes{std::istreambuf_iterator<char>(state), std::istreambuf_iterator<char>()};
  bytes[0] = static_cast<char>(bytes[0] ^ 1);  // of the layout
  state.seekp(0);
  state << bytes;
  state.close();
  boost::crc_32_type crc;
  crc.process_bytes(bytes.data(), bytes.size());
  const std::string other_members = refusal_of([&](YAML::Node* yaml) {
    (*yaml)["state"]["crc32"] = crc.checksum();
    (*yaml)["version"] = "7.8.9";
  });
  for (const char* word : {"other members", "replay it with version 7.8.9"})
    EXPECT_NE(other_members.find(word), std::string::npos)
        << word << " is not in: " << other_members;
}

TEST_F(FlightRecorderTest, DamagedFilesAreRefused) {
  const RecordingFiles files = writeRecording(record(2), target_, "asked");
  const auto refusal = [&] { return refusalOfReplay(files.yaml); };
  EXPECT_EQ(refusal(), "");
  fs::resize_file(files.state, fs::file_size(files.state) / 2);
  EXPECT_NE(refusal().find("damaged"), std::string::npos) << refusal();
  fs::remove(files.state);
  EXPECT_NE(refusal().find("missing"), std::string::npos) << refusal();
  std::ofstream(files.yaml) << "bag: [1, 2";
  EXPECT_NE(refusal().find("cannot be read"), std::string::npos) << refusal();
  std::ofstream(files.yaml) << "points: {levels: 3}\n";
  EXPECT_NE(refusal().find("cannot be read"), std::string::npos) << refusal();
}

}  // namespace
}  // namespace point_line_odometry
