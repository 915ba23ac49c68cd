/// \file
/// Writes a KITTI or EuRoC folder, or the synthetic world, to a bag for stereo nodes:
/// images, camera_info, static transforms and, where there is one, the ground truth as a path.

#include <iostream>
#include <memory>
#include <string>

#include "common/input_error.h"
#include "tools/command_line.h"
#include "tools/source_filters.h"
#include "tools/stereo_bag.h"
#include "tools/synthetic_source.h"

namespace point_line_odometry {
namespace {

namespace po = boost::program_options;

int runCommandLine(int argc, char** argv) {
  std::string dataset;
  StereoBagOptions options;
  MaskRequest masks;
  masks.of_source = true;
  long max_frames = 0;
  long every = 1;
  po::options_description visible("Options");
  // clang-format off
  visible.add_options()
      ("namespace", po::value(&options.name_space)->value_name("NS")->default_value("stereo"),
       "name space of the images")
      ("compression", po::value(&options.compression)->value_name("KIND")->default_value("none"),
       "none, lz4 or bz2")
      ("left-mask", po::value(&masks.files[0])->value_name("FILE"),
       "image of the left camera's size, 0 where its pixels are to be ignored")
      ("right-mask", po::value(&masks.files[1])->value_name("FILE"),
       "the same for the right camera")
      ("every", po::value(&every)->value_name("N"), "take every Nth frame")
      ("max-frames", po::value(&max_frames)->value_name("N"), "stop after N frames")
      ("quiet", po::bool_switch(&options.quiet), "no progress bar and no text")
      ("version", "print the version and the formats that are read, and end")
      ("help,h", "print this help and end");
  // clang-format on
  po::options_description all(visible);
  all.add_options()("dataset", po::value(&dataset))("bag", po::value(&options.file));
  const po::variables_map values = parseArguments(argc, argv, all, {"dataset", "bag"});
  if (values.count("help") > 0) {
    std::cout << "usage: dataset_to_bag DATASET OUT.bag [options]\n\n"
                 "Writes the folder of a KITTI or EuRoC sequence, or the synthetic world\n"
                 "(synthetic:SCENE[,name=value ...], see offline_odometry), to a bag:\n"
                 "  NS/left|right/image_rect (KITTI) or image_raw (EuRoC), mono8\n"
                 "  NS/left|right/camera_info   K, D, R and P of each camera\n"
                 "  NS/left|right/mask_image    masks given here or of the synthetic bonnet\n"
                 "  NS/imu                      if there is an IMU (EuRoC, synthetic world)\n"
                 "  /wheel_odom                 if there are wheels (synthetic world)\n"
                 "  /tf_static                  base_link -> left_camera -> right_camera\n"
                 "  /ground_truth/path          poses of base_link in odom, if there are any\n"
                 "base_link lies in the left camera, with x forward, y left and z up.\n\n"
              << visible;
    return 0;
  }
  if (dataset.empty()) throw InputError("no data set is given: name its folder");
  if (options.file.empty()) throw InputError("no bag is given: name the file to be written");
  requirePositive("--max-frames", max_frames, values);
  requirePositive("--every", every, values);
  options.max_frames = static_cast<std::size_t>(max_frames);
  const auto source =
      everyNth(masked(openDataset(dataset), masks), static_cast<std::size_t>(every));
  writeStereoBag(*source, options);
  return 0;
}

}  // namespace
}  // namespace point_line_odometry

int main(int argc, char** argv) {
  return point_line_odometry::runTool("dataset_to_bag", argc, argv,
                                      point_line_odometry::runCommandLine);
}
