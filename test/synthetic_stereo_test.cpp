/// The synthetic camera as a nodelet of this process: the messages that its subscribers get.

#include <gtest/gtest.h>
#include <nav_msgs/Odometry.h>
#include <nav_msgs/Path.h>
#include <nodelet/loader.h>
#include <ros/network.h>
#include <ros/ros.h>
#include <ros/xmlrpc_manager.h>
#include <rosgraph_msgs/Clock.h>
#include <sensor_msgs/CameraInfo.h>
#include <sensor_msgs/Image.h>
#include <tf2_ros/buffer.h>
#include <tf2_ros/transform_listener.h>
#include <xmlrpcpp/XmlRpcClient.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <cstring>
#include <functional>
#include <map>
#include <mutex>
#include <string>
#include <vector>

#include "ros/calibration_conversion.h"
#include "ros/camera_messages.h"
#include "ros/conversions.h"
#include "ros/synthetic_stereo_parameters.h"
#include "world/synthetic_world.h"

namespace point_line_odometry {
namespace {

constexpr double kTimeout_s = 20.0;
constexpr const char* kCamera = "/stereo/camera";

/// A subscriber that keeps everything.
template <typename Message>
class Collector {
 public:
  using Pointer = boost::shared_ptr<const Message>;

  void subscribe(ros::NodeHandle nh, const std::string& topic) {
    const boost::function<void(const Pointer&)> take = [this](const Pointer& message) {
      const std::lock_guard<std::mutex> lock(mutex_);
      messages_.push_back(message);
    };
    subscriber_ = nh.subscribe(topic, 1000, take);
  }

  std::vector<Pointer> messages() const {
    const std::lock_guard<std::mutex> lock(mutex_);
    return messages_;
  }

  std::size_t size() const { return messages().size(); }
  bool connected() const { return subscriber_.getNumPublishers() > 0; }

 private:
  mutable std::mutex mutex_;
  std::vector<Pointer> messages_;
  ros::Subscriber subscriber_;
};

bool waitFor(const std::function<bool()>& condition, double timeout_s = kTimeout_s) {
  const ros::SteadyTime end = ros::SteadyTime::now() + ros::WallDuration(timeout_s);
  while (!condition()) {
    if (ros::SteadyTime::now() > end) return false;
    ros::WallDuration(0.005).sleep();
  }
  return true;
}

/// Loads the nodelet, and subscribes to its topics with listen().
class CameraTest : public ::testing::Test {
 protected:
  CameraTest() : nh_("stereo"), loader_(false), spinner_(2) { spinner_.start(); }

  void TearDown() override {
    unload();
    ros::param::del(kCamera);
  }

  template <typename T>
  void set(const std::string& name, const T& value) {
    ros::param::set(std::string(kCamera) + "/" + name, value);
  }

  bool load() {
    loaded_ = loader_.load(kCamera, "point_line_odometry/SyntheticStereo", {}, {});
    return loaded_;
  }

  bool unload() {
    const bool was_loaded = loaded_;
    loaded_ = false;
    return was_loaded && loader_.unload(kCamera);
  }

  /// \param image image_rect or image_raw.
  void listen(const std::string& image) {
    ground_truth_.subscribe(nh_, "/ground_truth/odom");
    ASSERT_TRUE(waitFor([this] { return ground_truth_.connected(); }));
    left_.subscribe(nh_, "left/" + image);
    right_.subscribe(nh_, "right/" + image);
    left_info_.subscribe(nh_, "left/camera_info");
    right_info_.subscribe(nh_, "right/camera_info");
  }

  bool waitForFrames(std::size_t count) const {
    return waitFor([this, count] {
      return std::min({left_.size(), right_.size(), left_info_.size(), right_info_.size(),
                       ground_truth_.size()}) >= count;
    });
  }

  /// Asserts that the messages of a frame are those of the world's.
  void expectFrame(std::size_t index, const SyntheticWorld& world, std::size_t frame) const {
    const StereoImages images = world.render(frame);
    expectImage(*left_.messages()[index], images.left, "left_camera");
    expectImage(*right_.messages()[index], images.right, "right_camera");
    const ros::Time stamp = left_.messages()[index]->header.stamp;
    EXPECT_EQ(right_.messages()[index]->header.stamp, stamp);
    EXPECT_EQ(left_info_.messages()[index]->header.stamp, stamp);
    EXPECT_EQ(right_info_.messages()[index]->header.stamp, stamp);
    EXPECT_EQ(left_info_.messages()[index]->header.frame_id, "left_camera");
    EXPECT_EQ(right_info_.messages()[index]->header.frame_id, "right_camera");
    expectTruth(*ground_truth_.messages()[index], stamp, world, frame);
  }

  static void expectImage(const sensor_msgs::Image& message, const cv::Mat& image,
                          const std::string& frame_id) {
    EXPECT_EQ(message.encoding, "mono8");
    EXPECT_EQ(message.header.frame_id, frame_id);
    ASSERT_EQ(message.width, static_cast<std::uint32_t>(image.cols));
    ASSERT_EQ(message.height, static_cast<std::uint32_t>(image.rows));
    ASSERT_EQ(message.data.size(), image.total());
    ASSERT_TRUE(image.isContinuous());
    EXPECT_EQ(std::memcmp(message.data.data(), image.data, image.total()), 0) << "other pixels";
  }

  static void expectTruth(const nav_msgs::Odometry& message, const ros::Time& stamp,
                          const SyntheticWorld& world, std::size_t frame) {
    EXPECT_EQ(message.header.stamp, stamp);
    EXPECT_EQ(message.header.frame_id, "odom");
    EXPECT_EQ(message.child_frame_id, "base_link");
    const Eigen::Isometry3d T = toBasePose(world.pose(frame).T_world_camera);
    EXPECT_TRUE(toIsometry(message.pose.pose).isApprox(T, 1e-9));
    const Eigen::Isometry3d T_next = toBasePose(world.pose(frame + 1).T_world_camera);
    const double speed = (T_next.translation() - T.translation()).norm() * world.frameRate_hz();
    const auto& v = message.twist.twist.linear;
    EXPECT_NEAR(Eigen::Vector3d(v.x, v.y, v.z).norm(), speed, 0.05 * speed + 0.1);
  }

  void expectCalibration(const SyntheticWorld& world) const {
    const StereoCalibration got =
        toStereoCalibration(*left_info_.messages()[0], *right_info_.messages()[0]);
    EXPECT_EQ(got.left.P, world.calibration().left.P);
    EXPECT_EQ(got.right.P, world.calibration().right.P);
    EXPECT_EQ(got.left.K, world.calibration().left.K);
    EXPECT_EQ(got.right.D, world.calibration().right.D);
  }

  ros::NodeHandle nh_;
  Collector<sensor_msgs::Image> left_;
  Collector<sensor_msgs::Image> right_;
  Collector<sensor_msgs::CameraInfo> left_info_;
  Collector<sensor_msgs::CameraInfo> right_info_;
  Collector<nav_msgs::Odometry> ground_truth_;

 private:
  nodelet::Loader loader_;
  ros::AsyncSpinner spinner_;
  bool loaded_ = false;
};

/// True if messages of the topic go from publisher to subscriber as pointers.
bool isSharedInProcess(const std::string& topic) {
  std::string host;
  std::uint32_t port = 0;
  ros::network::splitURI(ros::XMLRPCManager::instance()->getServerURI(), host, port);
  XmlRpc::XmlRpcClient slave(host.c_str(), static_cast<int>(port));
  XmlRpc::XmlRpcValue request;
  XmlRpc::XmlRpcValue response;
  request[0] = ros::this_node::getName();
  if (!slave.execute("getBusInfo", request, response)) return false;
  XmlRpc::XmlRpcValue& connections = response[2];
  for (int i = 0; i < connections.size(); ++i) {
    const std::string transport = connections[i][3];
    const std::string of_topic = connections[i][4];
    if (of_topic == topic && transport == "INTRAPROCESS") return true;
  }
  return false;
}

SyntheticWorld makeWorld(const std::string& scene, int seed = 1) {
  SyntheticWorldOptions options;
  options.scene = scene;
  options.seed = seed;
  return SyntheticWorld(options);
}

// --- On the wall clock ------------------------------------------------------------------------

class RealTimeTest : public CameraTest {};

TEST_F(RealTimeTest, PublishesTheWorldAsACameraDoes) {
  set("scene", "corridor");
  set("seed", 5);
  ASSERT_TRUE(load());
  const ros::Time before = ros::Time::now();
  listen("image_raw");
  ASSERT_TRUE(waitForFrames(3));
  EXPECT_TRUE(unload());
  const SyntheticWorld world = makeWorld("corridor", 5);
  expectCalibration(world);
  const ros::Time first = left_.messages()[0]->header.stamp;
  EXPECT_GE(first, before);
  EXPECT_LE(first, ros::Time::now());
  for (std::size_t i = 0; i < 3; ++i) {
    const double frame = (left_.messages()[i]->header.stamp - first).toSec() * world.frameRate_hz();
    EXPECT_NEAR(frame, std::round(frame), 1e-6) << "a stamp between two frames";
    expectFrame(i, world, static_cast<std::size_t>(std::lround(frame)));
  }
}

TEST_F(RealTimeTest, SkipsWhatItIsTooSlowFor) {
  set("scene", "corridor");
  set("frame_rate_hz", 200.0);
  ASSERT_TRUE(load());
  listen("image_raw");
  ASSERT_TRUE(waitForFrames(4));
  const double simulated_s =
      (left_.messages()[3]->header.stamp - left_.messages()[0]->header.stamp).toSec();
  EXPECT_GT(simulated_s, 4.0 / 200.0) << "no frame was skipped";
  EXPECT_LT((ros::Time::now() - left_.messages()[3]->header.stamp).toSec(), 2.0) << "lags behind";
}

TEST_F(RealTimeTest, PublishesTheMountingOfTheCameras) {
  set("scene", "corridor");
  tf2_ros::Buffer buffer;
  const tf2_ros::TransformListener listener(buffer);
  ASSERT_TRUE(load());
  ASSERT_TRUE(waitFor([&] { return buffer.canTransform("base_link", "right_camera", {}); }));
  const Eigen::Isometry3d T_base_left =
      toIsometry(buffer.lookupTransform("base_link", "left_camera", {}).transform);
  EXPECT_TRUE((T_base_left * Eigen::Vector3d(1, 2, 3)).isApprox(Eigen::Vector3d(3, -1, -2), 1e-9));
  const Eigen::Isometry3d T_left_right =
      toIsometry(buffer.lookupTransform("left_camera", "right_camera", {}).transform);
  const double baseline_m = rectifiedCamera(makeWorld("corridor").calibration()).baseline_m;
  EXPECT_NEAR(T_left_right.translation().norm(), baseline_m, 1e-9);
  EXPECT_FALSE(buffer._frameExists("odom")) << "odom -> base_link is the odometry's";
}

TEST_F(RealTimeTest, BeginsWhenAllTopicsHaveSubscribers) {
  set("scene", "corridor");
  ASSERT_TRUE(load());
  ground_truth_.subscribe(nh_, "/ground_truth/odom");
  left_.subscribe(nh_, "left/image_raw");
  left_info_.subscribe(nh_, "left/camera_info");
  right_.subscribe(nh_, "right/image_raw");
  EXPECT_FALSE(waitFor([this] { return ground_truth_.size() > 0; }, 0.5));
  right_info_.subscribe(nh_, "right/camera_info");
  ASSERT_TRUE(waitForFrames(1));
  expectTruth(*ground_truth_.messages()[0], left_.messages()[0]->header.stamp,
              makeWorld("corridor"), 0);
}

TEST_F(RealTimeTest, NeedNotWaitForSubscribers) {
  set("scene", "corridor");
  set("wait_for_subscribers", false);
  ASSERT_TRUE(load());
  ground_truth_.subscribe(nh_, "/ground_truth/odom");
  EXPECT_TRUE(waitFor([this] { return ground_truth_.size() > 2; }));
}

TEST_F(RealTimeTest, SharesMessagesAndNeverWritesToThemAgain) {
  set("scene", "corridor");
  ASSERT_TRUE(load());
  listen("image_raw");
  ASSERT_TRUE(waitForFrames(1));
  const auto first = left_.messages()[0];
  const sensor_msgs::Image copy = *first;
  ASSERT_TRUE(waitForFrames(3));
  EXPECT_EQ(first->data, copy.data);
  EXPECT_EQ(first->header.stamp, copy.header.stamp);
  EXPECT_TRUE(isSharedInProcess("/stereo/left/image_raw")) << "images are copied";
}

TEST_F(RealTimeTest, UnloadsWhileItRenders) {
  for (const double delay_s : {0.0, 0.05, 0.1}) {
    set("scene", "corridor");
    ASSERT_TRUE(load());
    listen("image_raw");
    const std::size_t before = left_.size();
    ASSERT_TRUE(waitFor([&] { return left_.size() > before; }));
    ros::WallDuration(delay_s).sleep();
    const ros::SteadyTime begin = ros::SteadyTime::now();
    EXPECT_TRUE(unload());
    EXPECT_LT((ros::SteadyTime::now() - begin).toSec(), 3.0);
  }
}

TEST_F(RealTimeTest, DoesNotStartWithParametersThatItCannotUse) {
  set("noise", "much");
  EXPECT_FALSE(load());
  set("noise", 1.0);
  set("colour", true);
  EXPECT_FALSE(load());
  ros::param::del(std::string(kCamera) + "/colour");
  set("publish_clock", true);
  EXPECT_FALSE(load()) << "without use_sim_time nobody would follow its clock";
  set("publish_clock", false);
  EXPECT_TRUE(load());
}

// --- As the source of time --------------------------------------------------------------------

class SimulatedTimeTest : public CameraTest {
 protected:
  void SetUp() override {
    set("scene", "corridor");
    set("publish_clock", true);
    clock_.subscribe(nh_, "/clock");
  }

  Collector<rosgraph_msgs::Clock> clock_;
};

TEST_F(SimulatedTimeTest, PublishesEveryFrameAtItsTimeAndEnds) {
  constexpr std::size_t kFrames = 4;
  set("frames", static_cast<int>(kFrames));
  set("rate", 5.0);
  Collector<nav_msgs::Path> path;
  path.subscribe(nh_, "/ground_truth/path");
  ASSERT_TRUE(load());
  ASSERT_TRUE(waitFor([this] { return clock_.size() > 0; }))
      << "the clock is published, but stands still";
  listen("image_raw");
  ASSERT_TRUE(waitForFrames(kFrames));
  const auto path_is_whole = [&path] {
    return path.size() > 0 && path.messages().back()->poses.size() == kFrames;
  };
  EXPECT_TRUE(waitFor(path_is_whole));
  ros::WallDuration(0.3).sleep();
  ASSERT_EQ(left_.size(), kFrames);

  const SyntheticWorld world = makeWorld("corridor");
  for (std::size_t i = 0; i < kFrames; ++i) {
    expectFrame(i, world, i);
    const ros::Time stamp = left_.messages()[i]->header.stamp;
    EXPECT_EQ(toNanoseconds(stamp), 1000000000 + world.pose(i).stamp_ns);
    EXPECT_EQ(toNanoseconds(path.messages().back()->poses[i].header.stamp), toNanoseconds(stamp));
  }
  EXPECT_EQ(clock_.messages().front()->clock, ros::Time(1.0));
  EXPECT_EQ(clock_.messages().back()->clock, left_.messages().back()->header.stamp);
}

TEST_F(SimulatedTimeTest, EndsAfterADistance) {
  constexpr double kLength_m = 0.2;
  set("length", kLength_m);
  set("rate", 100.0);
  ASSERT_TRUE(load());
  listen("image_raw");
  const std::size_t frames = makeWorld("corridor").framesForLength(kLength_m);
  ASSERT_GT(frames, 2U);
  ASSERT_TRUE(waitForFrames(frames));
  EXPECT_FALSE(waitFor([&] { return left_.size() > frames; }, 0.5));
}

TEST_F(SimulatedTimeTest, IsNeverFasterThanItsRate) {
  set("rate", 0.25);
  ASSERT_TRUE(load());
  listen("image_raw");
  ASSERT_TRUE(waitForFrames(1));
  const ros::SteadyTime begin = ros::SteadyTime::now();
  ASSERT_TRUE(waitForFrames(4));
  EXPECT_GT((ros::SteadyTime::now() - begin).toSec(), 0.9 * 3.0 / 20.0 / 0.25);
}

TEST_F(SimulatedTimeTest, WaitsForTheAnswerToEachFrame) {
  set("lockstep_topic", "odom");
  set("rate", 100.0);
  ASSERT_TRUE(load());
  listen("image_raw");
  EXPECT_FALSE(waitFor([this] { return left_.size() > 0; }, 0.5)) << "nobody could answer";
  const ros::Publisher odometry = nh_.advertise<nav_msgs::Odometry>("odom", 10);
  for (std::size_t frame = 1; frame <= 4; ++frame) {
    ASSERT_TRUE(waitForFrames(frame));
    EXPECT_FALSE(waitFor([this, frame] { return left_.size() > frame; }, 0.3));
    nav_msgs::Odometry answer;
    answer.header.stamp = left_.messages().back()->header.stamp;
    odometry.publish(answer);
  }
  ASSERT_TRUE(waitForFrames(5));
  EXPECT_TRUE(waitForFrames(6)) << "it must not wait for ever";
}

// --- Parameters -------------------------------------------------------------------------------

XmlRpc::XmlRpcValue makeTree(const std::map<std::string, XmlRpc::XmlRpcValue>& values) {
  XmlRpc::XmlRpcValue tree;
  for (const auto& value : values) tree[value.first] = value.second;
  return tree;
}

void expectRefused(const std::map<std::string, XmlRpc::XmlRpcValue>& values,
                   const std::vector<std::string>& words) {
  try {
    parseSyntheticStereoParameters(makeTree(values));
  } catch (const std::runtime_error& error) {
    for (const std::string& word : words) {
      EXPECT_NE(std::string(error.what()).find(word), std::string::npos) << error.what();
    }
    return;
  }
  ADD_FAILURE() << "was not refused: " << words.front();
}

TEST(ParametersTest, SetsWorldAndCamera) {
  const SyntheticStereoParameters parameters = parseSyntheticStereoParameters(
      makeTree({{"scene", "indoor"}, {"noise", 3}, {"frames", 7}, {"left_frame_id", "cam0"}}));
  EXPECT_EQ(parameters.world.scene, "indoor");
  EXPECT_EQ(parameters.world.noise, 3.0);
  EXPECT_EQ(parameters.frames, 7);
  EXPECT_EQ(parameters.left_frame_id, "cam0");
  EXPECT_TRUE(parameters.wait_for_subscribers);
  EXPECT_TRUE(parameters.world.path.empty());
}

TEST(ParametersTest, NamesAllThatIsWrong) {
  expectRefused({{"scene", "moon"}, {"seed", 1.5}, {"frames", -1}, {"colour", "red"}},
                {"scene is 'moon'", "seed must be a whole number", "frames is -1", "~colour"});
}

TEST(ParametersTest, NamesContradictions) {
  const XmlRpc::XmlRpcValue yes(true);
  expectRefused({{"exit_when_done", yes}}, {"exit_when_done needs frames or length"});
  expectRefused({{"frames", 7}, {"length", 3.0}}, {"frames and length are both given"});
  expectRefused({{"rate", 2.0}}, {"rate needs publish_clock"});
  expectRefused({{"lockstep_topic", "odom"}}, {"lockstep_topic needs publish_clock"});
  expectRefused({{"base_frame_id", "odom"}}, {"four different names"});
  expectRefused({{"right_frame_id", ""}}, {"four different names"});
  expectRefused({{"path", "/no/such/file.tum"}}, {"/no/such/file.tum"});
}

}  // namespace
}  // namespace point_line_odometry

/// use_sim_time must be set before the process starts.
int main(int argc, char** argv) {
  ::testing::InitGoogleTest(&argc, argv);
  ros::init(argc, argv, "synthetic_stereo_test");
  const std::string tests = ::testing::GTEST_FLAG(filter);
  ros::param::set("/use_sim_time", tests.find("SimulatedTimeTest") == 0);
  const ros::NodeHandle keep_running;
  return RUN_ALL_TESTS();
}
