/// \file
/// Renders the synthetic world to a folder in KITTI's or EuRoC's layout, or to a bag.

#include <iostream>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "common/input_error.h"
#include "dataset/dataset_writer.h"
#include "tools/command_line.h"
#include "tools/output_folder.h"
#include "tools/parameter_text.h"
#include "tools/stereo_bag.h"
#include "tools/synthetic_source.h"

namespace point_line_odometry {
namespace {

namespace po = boost::program_options;

constexpr const char* kBagEnding = ".bag";

/// The marker file of a folder written by this program, with the options used.
constexpr const char* kMarker = "synthetic_world.yaml";

bool endsWith(const std::string& text, const std::string& ending) {
  return text.size() >= ending.size() &&
         text.compare(text.size() - ending.size(), ending.size(), ending) == 0;
}

/// kitti, euroc or bag. Throws InputError if the format cannot store the images.
std::string chooseFormat(const std::string& requested, const std::string& output, bool raw) {
  const std::string of_scene = raw ? "euroc" : "kitti";
  if (requested.empty()) return endsWith(output, kBagEnding) ? "bag" : of_scene;
  if (requested != "kitti" && requested != "euroc" && requested != "bag") {
    throw InputError("format '" + requested + "' is unknown: choose kitti, euroc or bag");
  }
  if (requested != "bag" && requested != of_scene) {
    throw InputError("format '" + requested + "' is for " + (raw ? "rectified" : "raw") +
                     " images, but those of this scene are " + (raw ? "raw" : "rectified") +
                     ": choose " + of_scene + " or bag");
  }
  return requested;
}

std::vector<ParameterRow> listOptions() {
  ParameterRows table;
  const SyntheticRequest defaults;
  visitSyntheticRequest(defaults, table);
  return table.rows;
}

/// The options of a folder, as parameters of the node synthetic_stereo.
std::string describe(const SyntheticRequest& request, std::size_t num_frames) {
  ParameterRows table;
  visitWorldOptions(request.world, table);
  std::string text = "# Written by synthetic_world.\n";
  for (const ParameterRow& row : table.rows) text += row.name + ": " + row.value + "\n";
  return text + "frames: " + std::to_string(num_frames) + "\npath: '" + request.path + "'\n";
}

void writeFolder(SyntheticSource& source, const std::string& output, const std::string& mark,
                 bool quiet) {
  const DatasetLayout layout =
      source.needsRectification() ? DatasetLayout::kEuroc : DatasetLayout::kKitti;
  const std::vector<StampedPose> ground_truth = source.groundTruth();
  NewFolder folder(output, kMarker, mark);
  DatasetWriter writer(folder.path(), layout, source.calibration(), source.frameRate_hz());
  std::size_t frame = 0;
  forEachPair(source, 0, quiet, [&](const StereoImages& images) {
    writer.add(images, ground_truth[frame++].T_world_camera);
  });
  if (const std::optional<ImuData> imu = source.imu()) writer.writeImu(*imu);
  writer.finish();
  folder.commit();
  if (!quiet) {
    std::cout << ground_truth.size() << " stereo pairs in " << output << ", "
              << (layout == DatasetLayout::kEuroc ? "EuRoC's layout\n" : "KITTI's layout\n");
  }
}

/// The world's options, generated from their table.
po::options_description describeWorldOptions() {
  po::options_description world("The world");
  for (const ParameterRow& row : listOptions()) {
    const std::string range = row.range.empty() ? "" : row.range + (row.unit.empty() ? "" : " ");
    const std::string value = row.value.empty() ? "none" : row.value;
    const std::string text = row.text + " (" + range + row.unit + (row.range.empty() ? "" : "; ") +
                             "default " + value + ")";
    world.add_options()(row.name.c_str(), po::value<std::string>()->value_name("X"), text.c_str());
  }
  return world;
}

void printHelp(const po::options_description& options) {
  std::cout << "usage: synthetic_world OUT [options]\n\n"
               "Renders what a stereo camera sees in a synthetic world, with the exact "
               "ground truth:\n"
               "  OUT.bag   as dataset_to_bag writes it\n"
               "  OUT       a folder in KITTI's layout (street) or EuRoC's (the others)\n"
               "The same options give the same bytes. To run the odometry on it without writing\n"
               "images: offline_odometry synthetic:street,seed=7,frames=400 -o DIR\n\n"
            << options;
}

int runCommandLine(int argc, char** argv) {
  StereoBagOptions bag;
  std::string format;
  po::options_description visible = describeWorldOptions();
  po::options_description output("Output");
  // clang-format off
  output.add_options()
      ("format", po::value(&format)->value_name("X"),
       "kitti, euroc or bag; default: by the ending of OUT and by the scene")
      ("namespace", po::value(&bag.name_space)->value_name("NS")->default_value("stereo"),
       "name space of a bag's images")
      ("compression", po::value(&bag.compression)->value_name("X")->default_value("none"),
       "of a bag: none, lz4 or bz2")
      ("quiet", po::bool_switch(&bag.quiet), "no progress bar and no text")
      ("print-parameters", "print the table of the world's options (Markdown) and end")
      ("version", "print the version and the formats that are read, and end")
      ("help,h", "print this help and end");
  // clang-format on
  visible.add(output);
  po::options_description all(visible);
  all.add_options()("out", po::value(&bag.file));
  const po::variables_map values = parseArguments(argc, argv, all, {"out"});
  if (values.count("help") > 0) {
    printHelp(visible);
    return 0;
  }
  if (values.count("print-parameters") > 0) {
    std::cout << formatMarkdownTable(listOptions());
    return 0;
  }
  if (bag.file.empty()) throw InputError("no output is given: name a folder, or a file OUT.bag");
  SyntheticRequestReader reader;
  for (const ParameterRow& row : listOptions()) {
    if (values.count(row.name) > 0) reader.set(row.name, values[row.name].as<std::string>());
  }
  const std::unique_ptr<SyntheticSource> source = reader.open();
  if (chooseFormat(format, bag.file, source->needsRectification()) == "bag") {
    writeStereoBag(*source, bag);
  } else {
    for (const char* option : {"namespace", "compression"}) {
      if (values[option].defaulted()) continue;
      throw InputError(std::string("option --") + option + " is for bags: name a file OUT.bag");
    }
    writeFolder(*source, bag.file, describe(reader.request(), source->size()), bag.quiet);
  }
  return 0;
}

}  // namespace
}  // namespace point_line_odometry

int main(int argc, char** argv) {
  return point_line_odometry::runTool("synthetic_world", argc, argv,
                                      point_line_odometry::runCommandLine);
}
