#include "ros/source_facts.h"

#include <cmath>
#include <iomanip>
#include <sstream>

namespace point_line_odometry {
namespace {

std::string whyNothing(const SourceFacts& source) {
  std::ostringstream text;
  text << "there are too few of them around the stamps of the images";
  if (source.newest_s) {
    text << ", the newest is " << std::fixed << std::setprecision(3) << std::abs(*source.newest_s)
         << " s " << (*source.newest_s < 0.0 ? "before" : "after") << " the last image";
  }
  text << ": compare both clocks, and the rate";
  return text.str();
}

}  // namespace

std::string faultOf(const std::string& name, const SourceFacts& source) {
  if (!source.counts.alive) return source.timeout;
  if (!source.fault.empty()) return name + " are not used: " + source.fault;
  if (source.frames_without >= SourceFacts::kManyFrames)
    return name + " come, but give the frames nothing: " + whyNothing(source);
  return "";
}

}  // namespace point_line_odometry
