#pragma once

/// \file
/// Function multiversioning. x86-64's baseline has vectors of 16 bytes and no popcount. Where the
/// compiler can, it makes a version for newer processors, too, and the loader selects the one that
/// the processor supports. Results are the same: none of these instruction sets has fused
/// multiply-add. With ThreadSanitizer there is one version: the selection would call its runtime
/// before it is initialized. With the CMake option POINT_LINE_ODOMETRY_PROCESSOR_CLONES=OFF, too:
/// that is how it runs on processors without AVX2, and on others than x86-64.

#if defined(__x86_64__) && defined(__GNUC__) && !defined(__clang__) && \
    !defined(__SANITIZE_THREAD__) && !defined(POINT_LINE_ODOMETRY_NO_PROCESSOR_CLONES)
#define POINT_LINE_ODOMETRY_CLONES(instructions) \
  __attribute__((target_clones(instructions, "default")))
#else
#define POINT_LINE_ODOMETRY_CLONES(instructions)
#endif
