#pragma once

#include <set>
#include <string>

namespace point_line_odometry {

/// Image topics of a pair; camera_info is expected in the same namespaces.
struct StereoTopics {
  std::string left;
  std::string right;

  /// True if their names are those of raw images.
  bool raw() const;
};

/// The camera_info topic of an image topic.
std::string cameraInfoTopic(const std::string& image_topic);

/// The topic of the masks of an image topic.
std::string maskTopic(const std::string& image_topic);

/// The topic of the right camera, derived from that of the left one; empty if that fails.
std::string rightTopicOf(const std::string& left_topic);

/// Names separated by commas, "none" if there are none.
std::string joinNames(const std::set<std::string>& names);

/// The pair under /stereo, or else the only pair NS/left/image_(rect|raw); rectified images are
/// preferred to raw ones. Throws InputError that lists the candidates if there is none, or more
/// than one.
StereoTopics findStereoTopics(const std::set<std::string>& image_topics);

}  // namespace point_line_odometry
