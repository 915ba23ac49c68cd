#include "ros/doctor_sequence.h"

#include <cmath>
#include <string>

#include "ros/doctor_lines.h"

namespace point_line_odometry {
namespace {

using Subject = DoctorSubject;

constexpr int kFewestFrames = 4;  // motion in the image before and after a pair, and its change

DoctorLine evaluateTrigger(const SequenceMeasurement& sequence) {
  constexpr double kTellsAbove_s = 5e-3;
  if (sequence.frames < kFewestFrames) {
    return unknownLine(Subject::kTrigger, "not measured: too few consecutive pairs");
  }
  if (!sequence.delay_s) {
    return okLine(Subject::kTrigger, "not checked: too few points move, or in too few pairs");
  }
  const double delay_s = *sequence.delay_s;
  if (sequence.notSimultaneous()) {
    return failureLine(
        Subject::kTrigger, DoctorLevel::kWarn,
        "right images are taken " + milliseconds(std::abs(delay_s)) +
            (delay_s > 0.0 ? " after" : " before") + " the left ones (+- " +
            milliseconds(sequence.delay_sigma_s) + ", from the motion in the images)",
        "let one signal trigger both cameras (hardware synchronisation), with the same exposure; "
        "stamps alone cannot mend it");
  }
  const double within_s = std::abs(delay_s) + 3.0 * sequence.delay_sigma_s;
  if (within_s > kTellsAbove_s) {
    return okLine(Subject::kTrigger,
                  "not checked: the camera moves too little, or in too few pairs");
  }
  return okLine(Subject::kTrigger,
                "both images are taken at the same time, within " + milliseconds(within_s));
}

DoctorLine checkTrigger(const SequenceMeasurement& sequence) {
  DoctorLine line = evaluateTrigger(sequence);
  if (sequence.delay_s) {
    line.values = {{"delay of the right images [ms]", number(1e3 * *sequence.delay_s, 3)},
                   {"its standard deviation [ms]", number(1e3 * sequence.delay_sigma_s, 3)}};
  }
  return line;
}

DoctorLine evaluateShutter(const SequenceMeasurement& sequence) {
  constexpr double kTellsBelow = 0.5;  // of the period
  if (sequence.frames < kFewestFrames) {
    return unknownLine(Subject::kShutter, "not measured: too few consecutive pairs");
  }
  if (!sequence.read_out_s) return okLine(Subject::kShutter, "not checked: too few points move");
  const double read_out_s = std::abs(*sequence.read_out_s);
  if (sequence.hasRollingShutter()) {
    return failureLine(
        Subject::kShutter, DoctorLevel::kWarn,
        "rolling shutter: rows are exposed one after the other, the " +
            std::string(*sequence.read_out_s > 0.0 ? "last" : "first") + " one " +
            milliseconds(read_out_s) + " after the " +
            (*sequence.read_out_s > 0.0 ? "first" : "last") + " (+- " +
            milliseconds(sequence.read_out_sigma_s) + ", from the motion in the images)",
        "set tracking/rolling_shutter_ms to " + number(1e3 * *sequence.read_out_s, 1) +
            " unless it is: without it the odometry takes all rows as of one instant; a camera "
            "with a global "
            "shutter, or a mode of a higher rate, which often reads out faster, leaves less to be "
            "known");
  }
  const double within_s = read_out_s + 3.0 * sequence.read_out_sigma_s;
  if (within_s > kTellsBelow * sequence.period_s) {
    return okLine(Subject::kShutter,
                  "not checked: the camera moves too evenly; turn it to and fro by hand");
  }
  return okLine(Subject::kShutter, "rows are exposed at the same time, within " +
                                       milliseconds(within_s) + " from first to last");
}

DoctorLine checkShutter(const SequenceMeasurement& sequence) {
  DoctorLine line = evaluateShutter(sequence);
  if (sequence.read_out_s) {
    line.values = {{"read-out of the rows [ms]", number(1e3 * *sequence.read_out_s, 3)},
                   {"its standard deviation [ms]", number(1e3 * sequence.read_out_sigma_s, 3)}};
  }
  return line;
}

DoctorLine evaluateProjector(const SequenceMeasurement& sequence) {
  constexpr int kFewestCompared = 100;
  if (sequence.frames < kFewestFrames) {
    return unknownLine(Subject::kProjector, "not measured: too few consecutive pairs");
  }
  if (sequence.pattern.isThere()) {
    return failureLine(Subject::kProjector, DoctorLevel::kWarn,
                       std::to_string(sequence.pattern.resting) + " of " +
                           std::to_string(sequence.pattern.compared) +
                           " points rest in the image while others as far away move: the pattern "
                           "of a projector",
                       "switch the infrared projector off (emitter_enabled 0), or use the images "
                       "that the camera takes without it");
  }
  if (sequence.pattern.compared < kFewestCompared) {
    return okLine(Subject::kProjector, "not checked: the camera hardly moves");
  }
  return okLine(Subject::kProjector, "no pattern rests in the image");
}

DoctorLine checkProjector(const SequenceMeasurement& sequence) {
  DoctorLine line = evaluateProjector(sequence);
  line.values = {{"points at rest", std::to_string(sequence.pattern.resting)},
                 {"points compared", std::to_string(sequence.pattern.compared)}};
  return line;
}

}  // namespace

std::vector<DoctorLine> checkSequence(const SequenceMeasurement& sequence) {
  return {checkTrigger(sequence), checkShutter(sequence), checkProjector(sequence)};
}

}  // namespace point_line_odometry
