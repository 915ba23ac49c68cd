#pragma once

/// \file
/// The package's feature messages under names that differ from the core's types: genmsg puts
/// PointFeature, LineFeature and StereoFeatures into the namespace in which the core has structs of
/// these names, so that both headers exclude each other. Only the short aliases are renamed here;
/// the message types themselves (PointFeature_<Allocator> ...) are untouched.

#include <geometry_msgs/Point32.h>
#include <ros/message_operations.h>
#include <ros/serialization.h>
#include <ros/types.h>
#include <std_msgs/Header.h>

#define PointFeature PointFeatureMessage
#define LineFeature LineFeatureMessage
#define StereoFeatures StereoFeaturesMessage
#include <point_line_odometry/LineFeature.h>
#include <point_line_odometry/PointFeature.h>
#include <point_line_odometry/StereoFeatures.h>
#undef PointFeature
#undef LineFeature
#undef StereoFeatures
