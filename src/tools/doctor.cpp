/// \file
/// Examines what a stereo camera publishes, live or in a bag, and says what keeps the odometry from
/// working and what to do about it.

#include "ros/doctor.h"

#include <ros/callback_queue.h>
#include <ros/init.h>
#include <ros/master.h>
#include <tf2_ros/buffer.h>
#include <tf2_ros/transform_listener.h>

#include <algorithm>
#include <iostream>
#include <string>

#include "ros/doctor_examination.h"
#include "ros/doctor_judgement.h"
#include "ros/stereo_subscriber.h"
#include "tools/command_line.h"
#include "tools/doctor_bag.h"
#include "tools/doctor_pairs.h"

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

/// Parameters of the command line over others.
void applyOptions(const Options& options, const po::variables_map& values,
                  NodeParameters* parameters) {
  if (values.count("rectify") > 0) parameters->rectify = options.rectify;
  if (!options.transport.empty()) parameters->image_transport = options.transport;
  if (!options.base_frame.empty()) parameters->base_frame_id = options.base_frame;
  if (values.count("approximate-sync") == 0) return;
  parameters->approximate_sync = options.max_interval_s > 0.0;
  parameters->approximate_sync_max_interval_s = options.max_interval_s;
}

/// \param facts those of the examination. \return the lines of the report.
std::vector<DoctorLine> conclude(const DoctorPairs& pairs, const AllParameters& parameters,
                                 DoctorFacts facts) {
  facts.frame_ms = pairs.medianFrameMs(parameters);
  return examine(facts);
}

std::vector<DoctorLine> examineLive(const Options& options, const po::variables_map& values) {
  if (!ros::master::check()) {
    throw InputError("no ROS master answers at " + ros::master::getURI() +
                     ": start the robot's or set ROS_MASTER_URI, or name a bag");
  }
  const ros::NodeHandle nh(options.name_space);
  AllParameters parameters = loadNodeParameters(ros::NodeHandle(nh, options.node));
  applyOptions(options, values, &parameters.node);
  tf2_ros::Buffer tf;
  const tf2_ros::TransformListener listener(tf, nh);
  DoctorExamination examination(parameters.node);
  DoctorPairs pairs;
  const StereoSubscriber subscriber(nh, ros::NodeHandle("~"), parameters.node,
                                    [&](const StereoMessages& set) {
                                      pairs.take(set, ros::WallTime::now().toSec(), &examination);
                                    });
  const ros::WallTime end = ros::WallTime::now() + ros::WallDuration(options.seconds);
  while (ros::WallTime::now() < end && ros::ok()) {
    throwIfInterrupted();
    ros::getGlobalCallbackQueue()->callOne(ros::WallDuration(0.05));
  }
  DoctorFacts facts = examination.facts(subscriber.facts(), tf);
  facts.image_topics = publishedImageTopics();
  facts.clock_stands = clockStands();
  return conclude(pairs, parameters, facts);
}

std::vector<DoctorLine> examineBag(const Options& options, const po::variables_map& values) {
  ros::Time::init();
  DoctorBag bag(options.bag);
  AllParameters parameters;
  StereoTopics topics = options.topics;
  if (topics.left.empty()) topics = bag.findTopics(options.name_space, options.rectify);
  if (topics.right.empty()) topics.right = rightTopicOf(topics.left);
  parameters.node.rectify = topics.raw();
  applyOptions(options, values, &parameters.node);
  DoctorExamination examination(parameters.node);
  DoctorPairs pairs;
  const auto take = [&](const StereoMessages& set, double time_s) {
    pairs.take(set, time_s, &examination);
  };
  const InputFacts input = bag.read(topics, parameters.node, options.seconds, take);
  DoctorFacts facts = examination.facts(input, bag.transforms());
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
       "odometry node within it, whose parameters are taken if it runs")
      ("rectify", po::value(&options.rectify)->value_name("BOOL")->implicit_value(true, "true"),
       "image_raw is taken and rectified by camera_info; default: as the node has it, or as "
       "the bag's topics are named")
      ("transport", po::value(&options.transport)->value_name("NAME"),
       "image transport: raw, compressed, ...")
      ("base-frame", po::value(&options.base_frame)->value_name("FRAME"),
       "frame whose pose is wanted; default: base_link, or as the node has it")
      ("approximate-sync", po::value(&options.max_interval_s)->value_name("SECONDS"),
       "stamps of a pair may differ by up to this")
      ("left-topic", po::value(&options.topics.left)->value_name("TOPIC"),
       "left images of a bag; default: as offline_odometry")
      ("right-topic", po::value(&options.topics.right)->value_name("TOPIC"),
       "right images of a bag; default: by the name of the left ones")
      ("seconds", po::value(&options.seconds)->value_name("S")->default_value(5.0, "5"),
       "how long to watch, or how much of a bag to read from its first image on")
      ("help,h", "print this help and end");
  // clang-format on
  po::options_description all(visible);
  all.add_options()("bag", po::value(&options.bag));
  const po::variables_map values = parseArguments(argc, argv, all, {"bag"});
  if (values.count("help") > 0) {
    std::cout << "usage: doctor [BAG] [options] [ROS remappings]\n\n"
                 "Examines the images of a stereo camera, live or in a bag: topics, stamps,\n"
                 "calibration, rectification, exchanged cameras, tf and time per frame. What\n"
                 "failed comes with its cure. Exit code 0: nothing failed; 1: a line says WARN or\n"
                 "ERROR; 2: nothing could be examined. Names are resolved as the odometry does:\n"
                 "  rosrun point_line_odometry doctor --ns stereo left/image_rect:=/cam0/image\n\n"
              << visible;
    return 0;
  }
  if (!(options.seconds >= 0.1) || options.seconds > 3600.0) {
    throw InputError("option --seconds must be a number from 0.1 to 3600");
  }
  if (!(options.max_interval_s >= 0.0) || options.max_interval_s > 1.0) {
    throw InputError("option --approximate-sync must be a number of seconds from 0 to 1");
  }
  return report(options.bag.empty() ? examineLive(options, values) : examineBag(options, values));
}

}  // namespace
}  // namespace point_line_odometry

int main(int argc, char** argv) {
  return point_line_odometry::runTool(
      "doctor", [&] { return point_line_odometry::runCommandLine(argc, argv); });
}
