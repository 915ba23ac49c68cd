#include "ros/mask_buffer.h"

#include <algorithm>

#include "ros/stereo_input.h"

namespace point_line_odometry {

MaskBuffer::MaskBuffer(const NodeParameters& parameters)
    : expected_{expectsMask(parameters, 0), expectsMask(parameters, 1)},
      wait_s_(parameters.mask_wait_s),
      capacity_(capacity(parameters)) {}

std::size_t MaskBuffer::capacity(const NodeParameters& parameters) {
  constexpr std::size_t kLeast = 50;
  return kLeast + pairsWhile(parameters.mask_wait_s);
}

void MaskBuffer::add(std::size_t camera, const sensor_msgs::ImageConstPtr& mask) {
  const std::lock_guard<std::mutex> lock(mutex_);
  masks_[camera].push_back(mask);
  if (masks_[camera].size() > capacity_) masks_[camera].pop_front();
}

/// The one that came last, if a bag is played again.
sensor_msgs::ImageConstPtr MaskBuffer::find(std::size_t camera,
                                            const sensor_msgs::Image& image) const {
  const std::lock_guard<std::mutex> lock(mutex_);
  const auto found =
      std::find_if(masks_[camera].rbegin(), masks_[camera].rend(),
                   [&](const auto& mask) { return mask->header.stamp == image.header.stamp; });
  return found == masks_[camera].rend() ? nullptr : *found;
}

bool MaskBuffer::isReady(const StereoMessages& messages, double waited_s) const {
  if (waited_s >= wait_s_) return true;
  return (!expected_[0] || find(0, *messages.left)) && (!expected_[1] || find(1, *messages.right));
}

StereoMessages MaskBuffer::withMasks(StereoMessages messages) {
  if (expected_[0]) messages.left_mask = find(0, *messages.left);
  if (expected_[1]) messages.right_mask = find(1, *messages.right);
  removeUntil(0, messages.left->header.stamp);
  removeUntil(1, messages.right->header.stamp);
  return messages;
}

void MaskBuffer::removeUntil(std::size_t camera, const ros::Time& stamp) {
  const std::lock_guard<std::mutex> lock(mutex_);
  auto& masks = masks_[camera];
  masks.erase(std::remove_if(masks.begin(), masks.end(),
                             [&](const auto& mask) { return mask->header.stamp <= stamp; }),
              masks.end());
}

std::vector<ros::Subscriber> subscribeToMasks(ros::NodeHandle nh, const NodeParameters& parameters,
                                              MaskBuffer* buffer) {
  const std::array<const char*, 2> topics{"left/mask_image", "right/mask_image"};
  std::vector<ros::Subscriber> subscribers;
  for (std::size_t camera = 0; camera < topics.size(); ++camera) {
    if (!expectsMask(parameters, camera)) continue;
    const boost::function<void(const sensor_msgs::ImageConstPtr&)> take =
        [buffer, camera](const sensor_msgs::ImageConstPtr& mask) { buffer->add(camera, mask); };
    subscribers.push_back(nh.subscribe(topics[camera], stereoQueueSize(parameters), take));
  }
  return subscribers;
}

}  // namespace point_line_odometry
