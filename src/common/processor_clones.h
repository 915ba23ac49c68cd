#pragma once

/// \file
/// Functions that are worth more than one version. x86-64's baseline is 20 years old: it has
/// vectors of 16 bytes and no instruction that counts bits. Where the compiler can, it makes a
/// version for newer processors, too, and the loader takes the one that the processor runs. Results
/// are the same: none of these instruction sets joins multiplications and additions. With
/// ThreadSanitizer there is one version: the choice would call its runtime before that has begun.

#if defined(__x86_64__) && defined(__GNUC__) && !defined(__clang__) && !defined(__SANITIZE_THREAD__)
#define POINT_LINE_ODOMETRY_CLONES(instructions) \
  __attribute__((target_clones(instructions, "default")))
#else
#define POINT_LINE_ODOMETRY_CLONES(instructions)
#endif
