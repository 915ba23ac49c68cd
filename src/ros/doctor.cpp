#include "ros/doctor.h"

#include <ros/console.h>
#include <ros/master.h>

#include <algorithm>
#include <chrono>
#include <exception>

#include "ros/doctor_judgement.h"

namespace point_line_odometry {
namespace {

constexpr double kWarnPeriodS = 5.0;

}  // namespace

std::vector<std::string> publishedImageTopics() {
  ros::master::V_TopicInfo topics;
  if (!ros::master::getTopics(topics)) return {};
  std::vector<std::string> names;
  for (const ros::master::TopicInfo& topic : topics) {
    if (topic.datatype == "sensor_msgs/Image" || topic.datatype == "sensor_msgs/CompressedImage") {
      names.push_back(topic.name);
    }
  }
  std::sort(names.begin(), names.end());
  return names;
}

bool clockStands() { return ros::Time::isSimTime() && ros::Time::now().isZero(); }

Doctor::Doctor(ros::NodeHandle nh, const NodeParameters& parameters, const std::string& name,
               const Patient& patient)
    : name_(name),
      patient_(patient),
      start_(ros::WallTime::now()),
      publisher_(nh.advertise<diagnostic_msgs::DiagnosticArray>("doctor", 1, true)),
      examination_(parameters),
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
  constexpr int kTicksPerExamination = 4;
  std::unique_lock<std::mutex> lock(mutex_);
  for (int tick = 1; !stopping_.wait_for(lock, kTick, [this] { return stopped_; }); ++tick) {
    lock.unlock();
    try {
      measureIfDue();
      if (tick % kTicksPerExamination == 0) examineAndReport();
    } catch (const std::exception& error) {
      ROS_ERROR_THROTTLE(kWarnPeriodS, "the doctor failed: %s", error.what());
    }
    lock.lock();
  }
}

/// A few times at the start, then so rarely that it costs less than a hundredth of a core.
void Doctor::measureIfDue() {
  constexpr int kAtStart = PairTrend::kWindow;
  constexpr double kPeriod_s = 5.0;
  if (age_s() < next_measurement_s_) return;
  const StereoMessages set = patient_.subscriber->facts().latest_set;
  if (!set.left || set.left == last_measured_.left) return;
  examination_.measure(set);
  last_measured_ = set;
  if (++num_measured_ >= kAtStart) next_measurement_s_ = age_s() + kPeriod_s;
}

void Doctor::examineAndReport() {
  const InputFacts input = patient_.subscriber->facts();
  const double age = age_s();
  lookForTopics(input, age);
  DoctorFacts facts = examination_.facts(input, *patient_.tf);
  facts.image_topics = image_topics_;
  facts.clock_stands = clockStands();
  facts.frame_ms = patient_.diagnostics->medianFrameMs();
  const std::vector<DoctorLine> lines = examine(facts);
  patient_.diagnostics->noteExamination(lines);
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

/// Asks the master what else there is, now and then while an image topic is silent.
void Doctor::lookForTopics(const InputFacts& input, double age_s) {
  constexpr double kPeriod_s = 10.0;
  const bool missing =
      input.topics[kLeftImage].messages == 0 || input.topics[kRightImage].messages == 0;
  if (!missing || age_s < next_look_s_) return;
  image_topics_ = publishedImageTopics();
  next_look_s_ = age_s + kPeriod_s;
}

}  // namespace point_line_odometry
