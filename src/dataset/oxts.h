#pragma once

#include <cstdint>
#include <string>

#include "dataset/imu_data.h"

namespace point_line_odometry {

/// The IMU of a KITTI raw drive: rates and accelerations (wx wy wz, ax ay az) of oxts/data/*.txt
/// with oxts/timestamps.txt, both below `folder`, and its mounting of calib_imu_to_velo.txt,
/// calib_velo_to_cam.txt and R_rect_00 of calib_cam_to_cam.txt, in `folder` or the one above it.
///
/// Stamps are those of times.txt, which begins at the first image: the time of that is the first
/// row of image_00/timestamps.txt (or image_0/timestamps.txt); without that file the first packet
/// is taken to be of the first image, as in the published drives with synchronised images, to some
/// ten milliseconds: the time offset is estimated online. \param first_ns stamp of the first image.
/// Throws InputError if a file is missing or damaged.
ImuData readOxts(const std::string& folder, std::int64_t first_ns);

}  // namespace point_line_odometry
