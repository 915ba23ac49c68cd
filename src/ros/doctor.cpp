#include "ros/doctor.h"

#include <ros/console.h>
#include <ros/master.h>
#include <ros/this_node.h>

#include <algorithm>
#include <chrono>
#include <exception>

#include "ros/doctor_rules.h"

namespace point_line_odometry {

std::vector<std::string> publishedImageTopics() {
  ros::master::V_TopicInfo topics;
  if (!ros::master::getTopics(topics)) return {};
  std::vector<std::string> names;
  for (const ros::master::TopicInfo& topic : topics) {
    const bool own = topic.name.find("/features_image") != std::string::npos;  // of the odometry
    if (!own &&
        (topic.datatype == "sensor_msgs/Image" || topic.datatype == "sensor_msgs/CompressedImage"))
      names.push_back(topic.name);
  }
  std::sort(names.begin(), names.end());
  return names;
}

bool isClockMissing() { return ros::Time::isSimTime() && ros::Time::now().isZero(); }

Doctor::Doctor(ros::NodeHandle nh, const NodeParameters& parameters, const std::string& name,
               const Sources& sources)
    : name_(name),
      sources_(sources),
      start_(ros::WallTime::now()),
      publisher_(nh.advertise<diagnostic_msgs::DiagnosticArray>("doctor", 1, true)),
      tf_parents_(nh, transformOfOdometry(parameters)),
      checks_(parameters),
      thread_(&Doctor::work, this) {}

Doctor::~Doctor() {
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    stopped_ = true;
  }
  stopping_.notify_all();
  thread_.join();
}

/// An exception that left this thread would end every nodelet of the manager.
void Doctor::work() {
  constexpr std::chrono::milliseconds kTick{250};
  constexpr int kTicksPerCheck = 4;
  std::unique_lock<std::mutex> lock(mutex_);
  for (int tick = 1; !stopping_.wait_for(lock, kTick, [this] { return stopped_; }); ++tick) {
    lock.unlock();
    try {
      measureIfDue();
      if (tick % kTicksPerCheck == 0) checkAndReport();
    } catch (const std::exception& error) {
      if (log_throttle_.passes("the doctor failed")) {
        ROS_ERROR("the doctor failed: %s", error.what());
      }
    }
    lock.lock();
  }
}

/// A few times at the start, then rarely enough to take some percent of a core.
void Doctor::measureIfDue() {
  constexpr int kAtStart = PairTrend::kWindow;
  constexpr double kPeriod_s = 5.0;
  if (age_s() < next_measurement_s_) return;
  const StereoMessages set = sources_.subscriber->facts().latest_set;
  if (!set.left || set.left == last_measured_.left) return;
  checks_.measure(set);
  last_measured_ = set;
  if (++num_measured_ >= kAtStart) next_measurement_s_ = age_s() + kPeriod_s;
}

void Doctor::checkAndReport() {
  const InputFacts input = sources_.subscriber->facts();
  const double age = age_s();
  lookForTopics(input, age);
  DoctorFacts facts = checks_.facts(input, *sources_.tf);
  facts.image_topics = image_topics_;
  facts.clock_missing = isClockMissing();
  facts.frame_ms = sources_.diagnostics->meanFrameMs();
  facts.masks = sources_.diagnostics->masks();
  facts.correction_px = sources_.diagnostics->correctionPx();
  facts.imu_source = sources_.diagnostics->imu();
  facts.wheels_source = sources_.diagnostics->wheels();
  addOtherParents(tf_parents_.othersThan(ros::this_node::getName()), *sources_.tf, &facts);
  const std::vector<DoctorLine> lines = checkInput(facts);
  sources_.diagnostics->noteCheck(lines);
  if (!schedule_.due(age, lines)) return;
  publisher_.publish(toDiagnosticArray(lines, name_, ros::Time::now()));
  const std::string report = "doctor, " + std::to_string(std::lround(age)) +
                             " s after the start: " + summarize(lines) + "\n" + formatReport(lines);
  if (worstLevel(lines) == DoctorLevel::kOk) {
    ROS_INFO_STREAM(report);
  } else {
    ROS_WARN_STREAM(report);
  }
}

/// Asks the master from time to time for other image topics while one of ours is missing.
void Doctor::lookForTopics(const InputFacts& input, double age_s) {
  constexpr double kPeriod_s = 10.0;
  const bool missing =
      input.topics[kLeftImage].messages == 0 || input.topics[kRightImage].messages == 0;
  if (!missing || age_s < next_look_s_) return;
  image_topics_ = publishedImageTopics();
  next_look_s_ = age_s + kPeriod_s;
}

}  // namespace point_line_odometry
