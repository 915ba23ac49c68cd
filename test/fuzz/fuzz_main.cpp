/// The entry point of libFuzzer, for the target FUZZ_TARGET.

#include <string>

#include "fuzz/fuzz_targets.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  for (const auto& target : point_line_odometry::kFuzzTargets) {
    if (std::string(target.name) == FUZZ_TARGET) target.run(data, size);
  }
  return 0;
}
