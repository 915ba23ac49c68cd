#include "tools/stereo_topics.h"

#include <cstddef>
#include <map>
#include <utility>

#include "common/input_error.h"

namespace point_line_odometry {

bool StereoTopics::raw() const { return left.find("rect", left.rfind('/')) == std::string::npos; }

std::string cameraInfoTopic(const std::string& image_topic) {
  return image_topic.substr(0, image_topic.rfind('/') + 1) + "camera_info";
}

std::string maskTopic(const std::string& image_topic) {
  return image_topic.substr(0, image_topic.rfind('/') + 1) + "mask_image";
}

std::string rightTopicOf(const std::string& left_topic) {
  for (const auto& [left, right] : {std::pair<const char*, const char*>{"/left/", "/right/"},
                                    {"/cam0/", "/cam1/"},
                                    {"/infra1/", "/infra2/"}}) {
    const std::size_t at = left_topic.rfind(left);
    if (at == std::string::npos) continue;
    return std::string(left_topic).replace(at, std::string(left).size(), right);
  }
  return {};
}

std::string joinNames(const std::set<std::string>& names) {
  std::string joined;
  for (const std::string& name : names) joined += (joined.empty() ? "" : ", ") + name;
  return joined.empty() ? "none" : joined;
}

StereoTopics findStereoTopics(const std::set<std::string>& image_topics) {
  std::map<std::string, StereoTopics> pairs;  // by name space
  for (const char* name : {"/left/image_rect", "/left/image_raw"}) {
    const std::string ending(name);
    for (const std::string& topic : image_topics) {
      if (topic.size() < ending.size()) continue;
      const std::string ns = topic.substr(0, topic.size() - ending.size());
      const std::string right = rightTopicOf(topic);
      if (ns + ending == topic && image_topics.count(right) > 0) pairs.insert({ns, {topic, right}});
    }
  }
  const auto stereo = pairs.find("/stereo");
  if (stereo != pairs.end()) return stereo->second;
  if (pairs.size() == 1) return pairs.begin()->second;
  if (pairs.empty()) {
    throw InputError(
        "has no topics NS/left/image_rect and NS/right/image_rect (or image_raw) of type "
        "sensor_msgs/Image: name them by --left-topic and --right-topic; image topics in it: " +
        joinNames(image_topics));
  }
  std::set<std::string> lefts;
  for (const auto& pair : pairs) lefts.insert(pair.second.left);
  throw InputError("has several stereo pairs: choose one by --left-topic; there are " +
                   joinNames(lefts));
}

}  // namespace point_line_odometry
