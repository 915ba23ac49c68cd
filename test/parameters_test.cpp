#include "point_line_odometry/parameters.h"

#include <gtest/gtest.h>
#include <unistd.h>

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <limits>
#include <map>
#include <set>
#include <sstream>
#include <stdexcept>

#include "common/retired_parameters.h"
#include "point_line_odometry/stereo_camera.h"
#include "synthetic_scene.h"

namespace point_line_odometry {
namespace {

namespace fs = std::filesystem;

bool contains(const std::string& text, const std::string& word) {
  return text.find(word) != std::string::npos;
}

/// Names of the table with their values as text.
struct Table {
  std::vector<std::string> names;
  std::map<std::string, std::string> values;

  template <typename T, typename... Rest>
  void operator()(const char* name, const T& value, const Rest&...) {
    names.push_back(name);
    std::ostringstream text;
    text << std::boolalpha << value;
    values[name] = text.str();
  }
};

Table tableOf(const Parameters& parameters) {
  Table table;
  visitParameters(parameters, table);
  return table;
}

/// Sets one number to something outside its range, on either side or not a number.
struct Spoiler {
  std::string name;
  enum { kBelow, kAbove, kNaN } how;
  bool done = false;

  void operator()(const char*, bool&, const char*) {}
  void operator()(const char* n, std::string& value, const std::vector<std::string>&, const char*) {
    if (name != n) return;
    value = "no such choice";
    done = true;
  }
  void operator()(const char* n, int& value, int low, int high, const char*, const char*) {
    if (name != n || how == kNaN) return;
    value = how == kBelow ? low - 1 : high + 1;
    done = true;
  }
  void operator()(const char* n, double& value, double low, double high, const char*, const char*) {
    if (name != n) return;
    value = how == kNaN ? std::nan("") : (how == kBelow ? low - 0.001 : high * 1.001 + 0.001);
    done = true;
  }
};

class ParametersTest : public ::testing::Test {
 protected:
  void SetUp() override {
    std::string name = (fs::temp_directory_path() / "point_line_parameters_XXXXXX").string();
    ASSERT_NE(mkdtemp(name.data()), nullptr);
    root_ = name;
  }
  void TearDown() override { fs::remove_all(root_); }

  std::string write(const std::string& text) const {
    std::ofstream(root_ / "parameters.yaml") << text;
    return (root_ / "parameters.yaml").string();
  }

  /// What the loader says of a file.
  std::string refusal(const std::string& text, const std::vector<std::string>& ignored = {}) const {
    try {
      loadParameters(write(text), ignored);
    } catch (const std::runtime_error& error) {
      return error.what();
    }
    return "";
  }

  fs::path root_;
};

// --- The table and its check

TEST_F(ParametersTest, DefaultsAreValid) { EXPECT_TRUE(checkParameters({}).empty()); }

TEST_F(ParametersTest, EveryMemberIsInTheTableOnce) {
  const Table table = tableOf({});
  EXPECT_EQ(std::set<std::string>(table.names.begin(), table.names.end()).size(),
            table.names.size());
  EXPECT_EQ(table.names.size(), 81U)
      << "a parameter came or went: put it here, into the table and into the files";
}

TEST_F(ParametersTest, EveryValueOutOfRangeIsNamed) {
  for (const std::string& name : tableOf({}).names) {
    for (const auto how : {Spoiler::kBelow, Spoiler::kAbove, Spoiler::kNaN}) {
      Parameters parameters;
      Spoiler spoiler{name, how};
      visitParameters(parameters, spoiler);
      const std::vector<std::string> errors = checkParameters(parameters);
      ASSERT_EQ(errors.size(), spoiler.done ? 1U : 0U) << name;
      if (spoiler.done) {
        EXPECT_EQ(errors[0].find(name + " is "), 0U) << errors[0];
      }
    }
  }
}

TEST_F(ParametersTest, AllBadOnesAreNamed) {
  Parameters parameters;
  parameters.points.levels = 0;
  parameters.motion.residual_images = "right";
  parameters.tracking.max_speed_m_s = std::numeric_limits<double>::infinity();
  const std::vector<std::string> errors = checkParameters(parameters);
  ASSERT_EQ(errors.size(), 3U);
  EXPECT_TRUE(contains(errors[0], "points/levels is 0, but must lie in [1, 8]")) << errors[0];
  EXPECT_TRUE(contains(errors[1], "motion/residual_images is 'right'")) << errors[1];
  EXPECT_TRUE(contains(errors[1], "left, both")) << errors[1];
  EXPECT_TRUE(contains(errors[2], "tracking/max_speed_m_s")) << errors[2];
}

TEST_F(ParametersTest, PointsOrLinesMustBeOn) {
  Parameters parameters;
  parameters.points.enabled = false;
  EXPECT_TRUE(checkParameters(parameters).empty());
  parameters.lines.enabled = false;
  ASSERT_EQ(checkParameters(parameters).size(), 1U);
  EXPECT_TRUE(contains(checkParameters(parameters)[0], "lines/enabled"));
}

// --- The loader

TEST_F(ParametersTest, LoadsWhatTheFileNamesAndKeepsTheRest) {
  const Parameters loaded =
      loadParameters(write("points: {levels: 5, scale_factor: 1.5}\nlines:\n  enabled: "
                           "false\nmotion:\n  residual_images: left\n"));
  EXPECT_EQ(loaded.points.levels, 5);
  EXPECT_EQ(loaded.points.scale_factor, 1.5);
  EXPECT_FALSE(loaded.lines.enabled);
  EXPECT_EQ(loaded.motion.residual_images, "left");
  EXPECT_EQ(loaded.points.cell_size_px, Parameters().points.cell_size_px);
}

TEST_F(ParametersTest, EveryParameterIsLoaded) {
  // Each is written alone with another legal value, and must be the only one that changes.
  const Table defaults = tableOf({});
  for (const std::string& name : defaults.names) {
    const std::string& old = defaults.values.at(name);
    std::string other = old == "true"                   ? "false"
                        : old == "false"                ? "true"
                        : old == "both"                 ? "left"
                        : old == "brief"                ? "orb"
                        : old == "edge_chains"          ? "lsd_or_edge_chains"
                        : old == "without_landmarks"    ? "never"
                        : name == "points/scale_factor" ? "1.5"  // 2 is its upper limit
                        : name == "imu/time_offset_s"   ? "0.01"
                                                        : "";
    if (other.empty()) {
      const double value = std::stod(old);
      other = value == 1.0         ? "2"
              : contains(old, ".") ? std::to_string(0.99 * value)
                                   : std::to_string(static_cast<int>(value) + 1);
    }
    const std::size_t slash = name.find('/');
    const std::string file =
        write(name.substr(0, slash) + ":\n  " + name.substr(slash + 1) + ": " + other + "\n");
    Table loaded;
    ASSERT_NO_THROW(loaded = tableOf(loadParameters(file))) << name << " " << other;
    for (const std::string& each : defaults.names) {
      EXPECT_EQ(loaded.values[each] != defaults.values.at(each), each == name)
          << name << " changed " << each;
    }
  }
}

TEST_F(ParametersTest, EmptyFileGivesDefaults) {
  EXPECT_EQ(tableOf(loadParameters(write(""))).values, tableOf({}).values);
  EXPECT_EQ(tableOf(loadParameters(write("# nothing\n"))).values, tableOf({}).values);
}

TEST_F(ParametersTest, UnknownNamesAreRefusedUnlessIgnored) {
  EXPECT_TRUE(contains(refusal("points:\n  level: 3\n"), "unknown parameter points/level"));
  EXPECT_TRUE(contains(refusal("odom_frame_id: odom\n"), "unknown parameter odom_frame_id"));
  EXPECT_EQ(refusal("odom_frame_id: odom\n", {"odom_frame_id"}), "");
}

TEST_F(ParametersTest, RetiredOnesAreIgnoredWithAWarning) {
  std::vector<std::string> warnings;
  const Parameters loaded =
      loadParameters(write("motion: {max_iterations: 7, min_matches: 9}\nwindow: {max_iterations: "
                           "none}\n"),
                     {}, &warnings);
  EXPECT_EQ(loaded.motion.min_matches, 9);
  ASSERT_EQ(warnings.size(), 2U);
  for (const char* word : {"motion/max_iterations is ignored", "1.0.0", "always 20"})
    EXPECT_TRUE(contains(warnings[0], word)) << word << " is not in: " << warnings[0];
  EXPECT_TRUE(contains(warnings[1], "window/max_iterations is ignored")) << warnings[1];
  EXPECT_EQ(refusal("motion: {max_iterations: 7}\n"), "") << "without a place for warnings";
  loadParameters(write("motion: {min_matches: 9}\n"), {}, &warnings);
  EXPECT_EQ(warnings.size(), 2U) << "of what is no longer there: nothing new";
}

TEST(RetiredParameters, AreNotInTheTable) {
  for (const std::string& name : tableOf({}).names) EXPECT_FALSE(isRetired(name, nullptr)) << name;
  for (const RetiredParameter& each : kRetiredParameters)
    EXPECT_TRUE(isRetired(each.name, nullptr)) << each.name;
}

TEST(RetiredParameters, AreWarnedOfOnce) {
  std::vector<std::string> warnings;
  EXPECT_TRUE(isRetired("motion/max_iterations", &warnings));
  EXPECT_TRUE(isRetired("motion/max_iterations", &warnings));
  EXPECT_FALSE(isRetired("motion/max_iteration", &warnings));
  EXPECT_EQ(warnings.size(), 1U);
}

TEST_F(ParametersTest, WrongTypesAreRefused) {
  EXPECT_TRUE(contains(refusal("points: {levels: many}\n"), "points/levels"));
  EXPECT_TRUE(contains(refusal("points: {levels: 2.5}\n"), "points/levels"));
  EXPECT_TRUE(contains(refusal("points: {enabled: 3}\n"), "points/enabled"));
  EXPECT_TRUE(contains(refusal("points: {levels: [1, 2]}\n"), "points/levels"));
  EXPECT_TRUE(contains(refusal("points: {levels: }\n"), "points/levels"));
  EXPECT_NE(refusal("points: 3\n"), "");
}

TEST_F(ParametersTest, AFileThatIsNotAMapIsRefused) {
  EXPECT_NE(refusal("- 1\n- 2\n"), "");
  EXPECT_NE(refusal("just words\n"), "");
}

TEST_F(ParametersTest, ValuesOutOfRangeAndNaNAreRefused) {
  EXPECT_TRUE(contains(refusal("lines: {max_count: 0}\n"), "lines/max_count is 0"));
  EXPECT_TRUE(contains(refusal("motion: {huber_delta: .nan}\n"), "motion/huber_delta"));
  EXPECT_TRUE(contains(refusal("motion: {huber_delta: .inf}\n"), "motion/huber_delta"));
}

TEST_F(ParametersTest, AllErrorsOfAFileAreNamedInOneLine) {
  const std::string text = refusal("points: {levels: 0, size: 3}\nmotion: {huber_delta: soft}\n");
  for (const char* word :
       {"parameters.yaml", "points/levels", "points/size", "motion/huber_delta"}) {
    EXPECT_TRUE(contains(text, word)) << word << " is not in: " << text;
  }
  EXPECT_FALSE(contains(text, "\n"));
}

TEST_F(ParametersTest, NamesThatAreNotTextAndRecursiveMapsAreRefused) {
  EXPECT_TRUE(contains(refusal("? [a, b]\n: 1\n"), "parameters.yaml"));
  EXPECT_TRUE(contains(refusal("points: &p\n  inner: *p\n"), "nested too deeply"));
}

TEST_F(ParametersTest, MissingAndBrokenFilesAreNamed) {
  EXPECT_TRUE(contains(refusal("points: [unclosed\n"), "parameters.yaml"));
  try {
    loadParameters((root_ / "absent.yaml").string());
    ADD_FAILURE() << "was not refused";
  } catch (const std::runtime_error& error) {
    EXPECT_TRUE(contains(error.what(), "absent.yaml"));
  }
}

// --- The files in config

const fs::path kConfig = fs::path(TEST_REPOSITORY_DIR) / "config";

/// Names of the leaves of a file of two levels, as in config.
std::vector<std::string> namesIn(const fs::path& file) {
  std::vector<std::string> names;
  std::ifstream stream(file);
  std::string section;
  for (std::string row; std::getline(stream, row);) {
    const std::size_t begin = row.find_first_not_of(' ');
    const std::size_t colon = row.find(':');
    if (begin == std::string::npos || row[begin] == '#' || colon == std::string::npos) continue;
    const std::string name = row.substr(begin, colon - begin);
    if (begin == 0) section = name;
    if (colon + 1 < row.size()) names.push_back(begin == 0 ? name : section + "/" + name);
  }
  return names;
}

/// Those that are not the core's, but the node's.
std::vector<std::string> othersIn(const fs::path& file) {
  const std::set<std::string> sections{"points",    "lines",    "matching", "motion", "window",
                                       "local_map", "tracking", "imu",      "wheels", "planar"};
  std::vector<std::string> others;
  for (const std::string& name : namesIn(file)) {
    if (sections.count(name.substr(0, name.find('/'))) == 0) others.push_back(name);
  }
  return others;
}

TEST(ConfigFiles, DefaultYamlNamesEveryParameterWithItsDefault) {
  const fs::path file = kConfig / "default.yaml";
  const Parameters loaded = loadParameters(file.string(), othersIn(file));
  const Table defaults = tableOf({});
  const Table in_file = tableOf(loaded);
  const std::vector<std::string> names = namesIn(file);
  for (const std::string& name : defaults.names) {
    EXPECT_EQ(in_file.values.at(name), defaults.values.at(name)) << name;
    EXPECT_EQ(std::count(names.begin(), names.end(), name), 1) << name;
  }
}

/// Of these the method does not depend: parameter_effects_test tries that.
const std::set<std::string> kNotOfThePaper{"window/keyframe_overlap",
                                           "window/points_per_cell",
                                           "local_map/size",
                                           "local_map/search_radius_px",
                                           "tracking/relocalization_s",
                                           "tracking/landmark_frames",
                                           "tracking/threads",
                                           "tracking/max_prior_prediction_s",
                                           "imu/gyroscope_noise",
                                           "imu/gyroscope_random_walk",
                                           "imu/range_deg_s",
                                           "imu/time_offset_s",
                                           "imu/estimate_time_offset",
                                           "imu/use_gravity",
                                           "imu/accelerometer_noise",
                                           "imu/accelerometer_random_walk",
                                           "wheels/slip_x",
                                           "wheels/slip_y",
                                           "wheels/slip_yaw",
                                           "wheels/speed_noise",
                                           "wheels/turn_noise",
                                           "planar/z_deviation",
                                           "planar/roll_deviation",
                                           "planar/pitch_deviation"};

TEST(ConfigFiles, PaperYamlNamesAllThatTheMethodDependsOn) {
  const std::vector<std::string> names = namesIn(kConfig / "paper.yaml");
  for (const std::string& name : tableOf({}).names) {
    EXPECT_EQ(std::count(names.begin(), names.end(), name), 1 - kNotOfThePaper.count(name))
        << name << ": a changed default would change the paper's method";
  }
}

TEST(ConfigFiles, AllLoad) {
  int files = 0;
  for (const auto& entry : fs::directory_iterator(kConfig)) {
    if (entry.path().extension() != ".yaml") continue;
    ++files;
    EXPECT_NO_THROW(loadParameters(entry.path().string(), othersIn(entry.path()))) << entry.path();
  }
  EXPECT_GE(files, 3);
}

// --- The camera

TEST(StereoCameraValidate, NamesTheBadField) {
  EXPECT_NO_THROW(synthetic::camera().validate());
  const auto refused = [](const char* name, auto member, auto value) {
    StereoCamera camera = synthetic::camera();
    camera.*member = value;
    try {
      camera.validate();
      ADD_FAILURE() << name << " " << value << " was not refused";
    } catch (const std::invalid_argument& error) {
      EXPECT_TRUE(contains(error.what(), name)) << error.what();
    }
  };
  for (const double bad : {0.0, -1.0, std::nan(""), std::numeric_limits<double>::infinity()}) {
    refused("fx", &StereoCamera::fx, bad);
    refused("fy", &StereoCamera::fy, bad);
    refused("baseline_m", &StereoCamera::baseline_m, bad);
  }
  for (const double bad : {1e4, -1e4, std::nan("")}) {
    refused("cx", &StereoCamera::cx, bad);
    refused("cy", &StereoCamera::cy, bad);
  }
  refused("width", &StereoCamera::width, 0);
  refused("height", &StereoCamera::height, -480);
}

}  // namespace
}  // namespace point_line_odometry
