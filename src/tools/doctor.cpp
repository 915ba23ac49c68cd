/// \file
/// Checks what a stereo camera publishes, live or in a bag: reports faults that keep the odometry
/// from working, with a hint for each.

#include "ros/doctor.h"

#include <ros/callback_queue.h>
#include <ros/init.h>
#include <ros/master.h>
#include <ros/this_node.h>
#include <tf2_ros/buffer.h>
#include <tf2_ros/transform_listener.h>
#include <xmlrpcpp/XmlRpcValue.h>

#include <algorithm>
#include <iostream>
#include <string>

#include "common/input_error.h"
#include "ros/conversions.h"
#include "ros/doctor_checks.h"
#include "ros/doctor_rules.h"
#include "ros/mask_buffer.h"
#include "ros/parameter_loader.h"
#include "ros/remapped_names.h"
#include "ros/sample_input.h"
#include "ros/stereo_subscriber.h"
#include "ros/tf_parents.h"
#include "tools/command_line.h"
#include "tools/doctor_bag.h"
#include "tools/doctor_pairs.h"
#include "tools/interruption.h"

namespace point_line_odometry {
namespace {

namespace po = boost::program_options;

struct Options {
  std::string bag;
  std::string name_space = "stereo";
  std::string node = "stereo_odometry";
  StereoTopics topics;  // of a bag
  double seconds = 5.0;
  bool rectify = false;
  std::string transport;
  std::string base_frame;
  double max_interval_s = 0.0;
};

/// Overrides parameters by those of the command line.
void applyOptions(const Options& options, const po::variables_map& values,
                  NodeParameters* parameters) {
  if (values.count("rectify") > 0) parameters->rectify = options.rectify;
  if (!options.transport.empty()) parameters->image_transport = options.transport;
  if (!options.base_frame.empty()) parameters->base_frame_id = options.base_frame;
  if (values.count("approximate-sync") == 0) return;
  parameters->approximate_sync = options.max_interval_s > 0.0;
  parameters->approximate_sync_max_interval_s = options.max_interval_s;
}

/// \param facts collected by the checks. \return the lines of the report.
std::vector<DoctorLine> conclude(const DoctorPairs& pairs, const AllParameters& parameters,
                                 DoctorFacts facts) {
  if (!facts.sequence) facts.sequence.emplace();  // nothing could be followed: the lines say so
  pairs.process(parameters, &facts);
  return checkInput(facts);
}

// Processed sets: for the speed, and enough of them that the camera's motion tells the trigger, the
// shutter and the axes of an IMU.
constexpr std::size_t kSets = 60;

/// The IMU of a node that uses it; an empty subscriber otherwise.
ros::Subscriber subscribeToImu(ros::NodeHandle nh, const AllParameters& parameters,
                               ImuCheckFacts* imu) {
  if (!parameters.core.imu.enabled) return {};
  imu->topic = nh.resolveName("imu");
  constexpr std::size_t kMost = 100000;
  const boost::function<void(const sensor_msgs::ImuConstPtr&)> take =
      [imu](const sensor_msgs::ImuConstPtr& message) {
        if (imu->samples.size() >= kMost) return;
        imu->frame = withoutLeadingSlash(message->header.frame_id);
        imu->samples.push_back(toSample(*message).sample);
      };
  constexpr std::uint32_t kQueueSize = 2000;
  return nh.subscribe("imu", kQueueSize, take);
}

/// Adds the samples, with the axes of the IMU that tf gives.
void addImu(ImuCheckFacts imu, const AllParameters& parameters, const tf2::BufferCore& tf,
            DoctorFacts* facts) {
  imu.parameters = parameters.core.imu;
  try {
    if (!imu.frame.empty()) {
      const auto transform = tf.lookupTransform(facts->camera_frame, imu.frame, ros::Time(0));
      imu.R_camera_imu = toIsometry(transform.transform).linear();
    }
  } catch (const tf2::TransformException&) {
    imu.R_camera_imu.reset();  // the line says so
  }
  facts->imu = std::move(imu);
}

/// Name of the node that offers a service, as the master knows it; empty if none does.
std::string providerOf(const std::string& service) {
  XmlRpc::XmlRpcValue arguments;
  XmlRpc::XmlRpcValue response;
  XmlRpc::XmlRpcValue state;
  arguments[0] = ros::this_node::getName();
  if (!ros::master::execute("getSystemState", arguments, response, state, false)) return "";
  XmlRpc::XmlRpcValue& services = state[2];
  for (int i = 0; i < services.size(); ++i) {
    const std::string name = services[i][0];
    if (name == service && services[i][1].size() > 0) return services[i][1][0];
  }
  return "";
}

void spinFor(double seconds) {
  const ros::WallTime end = ros::WallTime::now() + ros::WallDuration(seconds);
  while (ros::WallTime::now() < end && ros::ok()) {
    throwIfInterrupted();
    ros::getGlobalCallbackQueue()->callOne(ros::WallDuration(0.05));
  }
}

std::vector<DoctorLine> checkLive(const Options& options, const po::variables_map& values) {
  if (!ros::master::check()) {
    throw InputError("no ROS master answers at " + ros::master::getURI() +
                     ": start the robot's or set ROS_MASTER_URI, or name a bag");
  }
  const ros::NodeHandle node(ros::NodeHandle(options.name_space), options.node);
  AllParameters parameters = loadNodeParameters(node);
  const ros::NodeHandle nh(options.name_space, loadRemappings(node));
  const std::string odometry = providerOf(node.resolveName("reset"));
  if (odometry.empty() && node.hasParam("")) {
    std::cerr << "doctor: " << node.getNamespace()
              << " does not run; its last parameters and topics are used ('rosparam delete "
              << node.getNamespace() << "' for the defaults)\n";
  }
  applyOptions(options, values, &parameters.node);
  tf2_ros::Buffer tf;
  const tf2_ros::TransformListener listener(tf, nh);
  const TfParents tf_parents(nh, transformOfOdometry(parameters.node));
  DoctorChecks checks(parameters.node);
  DoctorPairs pairs(kSets);
  ImuCheckFacts imu;
  const ros::Subscriber imu_subscriber = subscribeToImu(nh, parameters, &imu);
  MaskBuffer masks(parameters.node);
  const auto mask_subscribers = subscribeToMasks(nh, parameters.node, &masks);
  bool watching = true;
  const StereoSubscriber subscriber(nh, ros::NodeHandle("~"), parameters.node,
                                    [&](const StereoMessages& set) {
                                      if (watching) pairs.take(set, ros::WallTime::now().toSec());
                                    });
  spinFor(options.seconds);
  watching = false;
  const InputFacts input = subscriber.facts();  // before anything that takes time
  if (!mask_subscribers.empty()) spinFor(parameters.node.mask_wait_s);
  pairs.addMasks(&masks);
  pairs.measure(&checks);
  DoctorFacts facts = checks.facts(input, tf);
  facts.odometry_runs = !odometry.empty();
  addOtherParents(tf_parents.othersThan(odometry), tf, &facts);
  if (imu_subscriber) addImu(imu, parameters, tf, &facts);
  facts.image_topics = publishedImageTopics();
  facts.clock_missing = isClockMissing();
  return conclude(pairs, parameters, facts);
}

std::vector<DoctorLine> checkBag(const Options& options, const po::variables_map& values) {
  DoctorBag bag(options.bag);
  AllParameters parameters;
  const StereoTopics topics = bag.findTopics(options.topics, options.name_space, options.rectify);
  parameters.node.rectify = topics.raw();
  applyOptions(options, values, &parameters.node);
  const std::string imu_topic = bag.findImu(topics);
  DoctorPairs pairs(kSets);
  const auto take = [&](const StereoMessages& set, double time_s) { pairs.take(set, time_s); };
  parameters.node.mask_images = bag.maskImages(topics);
  MaskBuffer masks(parameters.node);
  const InputFacts input = bag.read(topics, parameters.node, options.seconds, take);
  bag.readMasks(topics, pairs.stamps(), &masks);
  pairs.addMasks(&masks);
  DoctorChecks checks(parameters.node, true);
  pairs.measure(&checks);
  DoctorFacts facts = checks.facts(input, bag.transforms());
  if (!imu_topic.empty()) addImu(bag.readImu(imu_topic), parameters, bag.transforms(), &facts);
  facts.from_bag = true;
  facts.image_topics = bag.imageTopics();
  return conclude(pairs, parameters, facts);
}

int report(const std::vector<DoctorLine>& lines) {
  std::cout << formatReport(lines) << summarize(lines) << '\n';
  const bool failed = worstLevel(lines) >= DoctorLevel::kWarn;
  return failed ? 1 : 0;
}

int runCommandLine(int argc, char** argv) {
  ros::init(argc, argv, "doctor",
            ros::init_options::AnonymousName | ros::init_options::NoSigintHandler);
  Options options;
  po::options_description visible("Options");
  // clang-format off
  visible.add_options()
      ("ns", po::value(&options.name_space)->value_name("NS")->default_value("stereo"),
       "namespace of the camera")
      ("node", po::value(&options.node)->value_name("NAME")->default_value("stereo_odometry"),
       "odometry node within it, whose parameters are used if it runs")
      ("rectify", po::value(&options.rectify)->value_name("BOOL")->implicit_value(true, "true"),
       "use image_raw and rectify with camera_info; default: as the node does, or by the "
       "names of the bag's topics")
      ("transport", po::value(&options.transport)->value_name("NAME"),
       "image transport: raw, compressed, ...")
      ("base-frame", po::value(&options.base_frame)->value_name("FRAME"),
       "frame whose pose is estimated; default: base_link, or that of the node")
      ("approximate-sync", po::value(&options.max_interval_s)->value_name("SECONDS"),
       "stamps of a pair may differ by up to this")
      ("left-topic", po::value(&options.topics.left)->value_name("TOPIC"),
       "left images of a bag; default: as offline_odometry")
      ("right-topic", po::value(&options.topics.right)->value_name("TOPIC"),
       "right images of a bag; default: by the name of the left ones")
      ("seconds", po::value(&options.seconds)->value_name("S")->default_value(5.0, "5"),
       "how long to watch, or how much of a bag to read from its first image on")
      ("version", "print the version and the formats that are read, and end")
      ("help,h", "print this help and end");
  // clang-format on
  po::options_description all(visible);
  all.add_options()("bag", po::value(&options.bag));
  const po::variables_map values = parseArguments(argc, argv, all, {"bag"});
  if (values.count("help") > 0) {
    std::cout << "usage: doctor [BAG] [options] [ROS remappings]\n\n"
                 "Checks the images of a stereo camera, live or in a bag: topics, stamps,\n"
                 "calibration, rectification, swapped cameras, tf and time per frame. Each fault\n"
                 "has a hint. Exit code 0: nothing failed; 1: a line says WARN or ERROR; 2:\n"
                 "nothing could be checked. Names are resolved as the odometry does:\n"
                 "  rosrun point_line_odometry doctor --ns stereo "
                 "/stereo/left/image_rect:=/cam0/image\n\n"
              << visible;
    return 0;
  }
  if (!(options.seconds >= 0.1) || options.seconds > 3600.0) {
    throw InputError("option --seconds must be a number from 0.1 to 3600");
  }
  if (!(options.max_interval_s >= 0.0) || options.max_interval_s > 1.0) {
    throw InputError("option --approximate-sync must be a number of seconds from 0 to 1");
  }
  if (options.bag.empty()) {
    refuseOptions(values, {"left-topic", "right-topic"},
                  "bags; remap the names of a live camera: /stereo/left/image_rect:=TOPIC");
  } else {
    refuseOptions(values, {"node", "transport"}, "a live camera, not for a bag");
  }
  return report(options.bag.empty() ? checkLive(options, values) : checkBag(options, values));
}

}  // namespace
}  // namespace point_line_odometry

int main(int argc, char** argv) {
  return point_line_odometry::runTool("doctor", argc, argv, point_line_odometry::runCommandLine);
}
