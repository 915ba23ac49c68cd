#include "ros/doctor_topics.h"

#include <algorithm>
#include <optional>
#include <string>

#include "common/join.h"
#include "ros/doctor_lines.h"

namespace point_line_odometry {
namespace {

using Level = DoctorLevel;
using Subject = DoctorSubject;

const TopicFacts& topicOf(const DoctorFacts& facts, StereoTopic topic) {
  return facts.input.topics[topic];
}

bool isImage(StereoTopic topic) { return topic == kLeftImage || topic == kRightImage; }

/// Text on the image topics available instead of a missing one, and how to use them.
std::string otherTopics(const DoctorFacts& facts, StereoTopic topic) {
  if (!isImage(topic)) return "";
  if (facts.image_topics.empty()) return facts.from_bag ? "; it has no images at all" : "";
  const std::string other = stereoTopicName(topic, !facts.parameters.rectify);
  const bool other_kind = std::any_of(
      facts.image_topics.begin(), facts.image_topics.end(), [&](const std::string& name) {
        return name.size() >= other.size() &&
               name.compare(name.size() - other.size(), other.size(), other) == 0;
      });
  std::string text = "; images are on " + join(facts.image_topics, ", ");
  for (const std::string& name : facts.image_topics) {
    const std::string& missing = topicOf(facts, topic).name;
    if (name.compare(0, missing.size() + 1, missing + "/") != 0) continue;
    text += facts.from_bag ? ": decompress them into another bag (image_transport republish)"
                           : ": set image_transport to " + name.substr(missing.size() + 1);
    return text;
  }
  if (other_kind) {
    text += facts.parameters.rectify ? ": set rectify to false for rectified ones"
                                     : ": set rectify to true for raw ones";
  }
  return text;
}

std::string hintForMissing(const DoctorFacts& facts, StereoTopic topic) {
  const TopicFacts& seen = topicOf(facts, topic);
  if (facts.from_bag) {
    return "record it, or name the topics by --ns, --rectify or --left-topic" +
           otherTopics(facts, topic);
  }
  if (seen.publishers.value_or(0) > 0) {
    return "it is advertised: start or resume what publishes it; if 'rostopic hz' shows it on the "
           "publisher's computer only, set ROS_IP on both computers to addresses they can reach";
  }
  return "start what publishes it, or remap the name or namespace to what is published" +
         otherTopics(facts, topic);
}

DoctorLine checkTopic(const DoctorFacts& facts, Subject subject, StereoTopic topic) {
  constexpr double kShortestTimeout_s = 2.0;
  constexpr double kTimeoutPeriods = 5.0;
  const TopicFacts& seen = topicOf(facts, topic);
  if (seen.messages == 0) {
    return failureLine(subject, Level::kError, "nothing arrives on " + seen.name,
                       hintForMissing(facts, topic));
  }
  const double patience_s =
      std::max(kShortestTimeout_s, seen.rate_hz > 0.0 ? kTimeoutPeriods / seen.rate_hz : 0.0);
  const std::string count = seen.name + ": " + std::to_string(seen.messages) + " messages";
  DoctorLine line =
      seen.since_latest_s > patience_s
          ? failureLine(
                subject, Level::kError,
                count + ", but nothing any more for " + number(seen.since_latest_s, 1) + " s",
                "restart this camera, or go on with the bag if it is paused or has ended")
          : okLine(subject, count + ", " + number(seen.rate_hz, 1) + " Hz");
  line.values = {{"messages", std::to_string(seen.messages)},
                 {"rate [1/s]", number(seen.rate_hz, 2)}};
  return line;
}

/// Image pairs that did not become part of a complete set.
std::uint64_t unsynchronizedOf(const InputFacts& input) {
  const std::uint64_t pairs =
      std::min(input.topics[kLeftImage].messages, input.topics[kRightImage].messages);
  return pairs > input.sets ? pairs - input.sets : 0;
}

DoctorLine failedStamps(const DoctorFacts& facts, const std::string& what, double skew_s) {
  const std::string text = what + " differ by " + milliseconds(skew_s) + " (median)";
  const std::string above = number(skew_s, 4) + " s";
  if (facts.parameters.approximate_sync) {
    return failureLine(Subject::kStamps, Level::kError, text,
                       "raise approximate_sync_max_interval_s above " + above +
                           ", or trigger both cameras together");
  }
  return failureLine(
      Subject::kStamps, Level::kError, text,
      "trigger both cameras together and give the images and camera_info of a pair the "
      "same stamp; if the difference is small, set approximate_sync to true and "
      "approximate_sync_max_interval_s above " +
          above);
}

std::optional<DoctorLine> stampsOfArrival(const SequenceMeasurement& sequence) {
  if (!sequence.hasArrivalStamps()) return std::nullopt;
  return failureLine(Subject::kStamps, Level::kWarn,
                     std::to_string(sequence.bursts) + " of " + std::to_string(sequence.frames) +
                         " pairs are stamped right after the one before, as by a driver that "
                         "stamps what arrives",
                     "let the driver stamp images with the time of exposure; stop what keeps the "
                     "computer or the camera's bus busy");
}

DoctorLine evaluateStamps(const DoctorFacts& facts) {
  constexpr double kMostUnsynchronized = 0.2;
  constexpr std::uint64_t kFew = 5;
  const InputFacts& input = facts.input;
  if (!input.image_skew_s) return unknownLine(Subject::kStamps, "no images of both cameras yet");
  if (input.unstamped && facts.clock_missing) {
    return failureLine(Subject::kStamps, Level::kError,
                       "messages have the stamp 0, as use_sim_time is set but no /clock arrives",
                       kHintForClock);
  }
  if (input.unstamped) {
    return failureLine(Subject::kStamps, Level::kError, "messages have the stamp 0",
                       "let the driver stamp images and camera_info with the time of exposure");
  }
  const double most_s =
      facts.parameters.approximate_sync ? facts.parameters.approximate_sync_max_interval_s : 0.0;
  if (*input.image_skew_s > most_s) {
    return failedStamps(facts, "stamps of left and right images", *input.image_skew_s);
  }
  if (!input.info_skew_s)
    return unknownLine(Subject::kStamps, "no camera_info of both cameras yet");
  if (*input.info_skew_s > most_s) {
    return failedStamps(facts, "stamps of images and camera_info", *input.info_skew_s);
  }
  const std::uint64_t unsynchronized = unsynchronizedOf(input);
  const auto pairs = static_cast<double>(input.sets + unsynchronized);
  if (unsynchronized > kFew && static_cast<double>(unsynchronized) > kMostUnsynchronized * pairs) {
    return failureLine(
        Subject::kStamps, Level::kWarn,
        std::to_string(unsynchronized) + " of " + number(pairs, 0) +
            " image pairs lacked an image or camera_info of the same stamp",
        "look for messages that are lost in transport (rostopic hz of each topic), and "
        "publish camera_info with every image");
  }
  if (facts.sequence) {
    if (const auto line = stampsOfArrival(*facts.sequence)) return *line;
  }
  return okLine(Subject::kStamps,
                "left and right " +
                    (*input.image_skew_s > 0.0 ? "differ by " + milliseconds(*input.image_skew_s)
                                               : std::string("agree")) +
                    ", " + std::to_string(input.sets) + " complete sets");
}

DoctorLine checkStamps(const DoctorFacts& facts) {
  DoctorLine line = evaluateStamps(facts);
  const InputFacts& input = facts.input;
  if (input.image_skew_s) {
    line.values.emplace_back("skew of left and right [ms]", number(1e3 * *input.image_skew_s, 3));
  }
  if (input.info_skew_s) {
    line.values.emplace_back("skew of image and camera_info [ms]",
                             number(1e3 * *input.info_skew_s, 3));
  }
  return line;
}

}  // namespace

std::vector<DoctorLine> checkTopics(const DoctorFacts& facts) {
  return {checkTopic(facts, Subject::kLeftImage, kLeftImage),
          checkTopic(facts, Subject::kRightImage, kRightImage),
          checkTopic(facts, Subject::kLeftInfo, kLeftInfo),
          checkTopic(facts, Subject::kRightInfo, kRightInfo), checkStamps(facts)};
}

}  // namespace point_line_odometry
