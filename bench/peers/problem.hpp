// SPDX-License-Identifier: GPL-3.0-or-later
/// The two bodies of the comparison and how its lines are measured and printed.
#pragma once

#include "efree/geometry/input/label_image.hpp"

#include <sys/resource.h>
#include <cmath>
#include <cstdio>
#include <ctime>
#include <numbers>
#include <string>

namespace peers {

/// Moduli of the bodies themselves, not of their voxels; see README.md for where they are from.
inline constexpr double block_modulus = 0.4653, gyroid_modulus = 0.0868;

/// A cube of 128 voxels a side with spherical pores.
inline efree::LabelImage<3> porous_block() {
  return efree::keep_largest(efree::random_spheres<3>(128, {.porosity = 0.3, .r_min = 6.0, .r_max = 14.0})).image;
}

/// A sheet around Schoen's gyroid with three periods along each side of [0, 96]^3: inside where negative.
inline double gyroid(double x, double y, double z) {
  constexpr double k = 2.0 * std::numbers::pi / 32.0;
  return std::abs(std::sin(k * x) * std::cos(k * y) + std::sin(k * y) * std::cos(k * z) +
                  std::sin(k * z) * std::cos(k * x)) -
         0.4;
}
/// The same as voxels of edge 96 / n, solid where their centre is.
inline efree::LabelImage<3> gyroid_voxels(efree::Index n) {
  const double h = 96.0 / n;
  efree::LabelImage<3> image{{n, n, n}, efree::Vec<3>::Constant(h)};
  for (efree::Index k = 0; k < n; ++k)
    for (efree::Index j = 0; j < n; ++j)
      for (efree::Index i = 0; i < n; ++i)
        image.labels.push_back(gyroid((i + 0.5) * h, (j + 0.5) * h, (k + 0.5) * h) < 0.0 ? 1 : 0);
  return efree::keep_largest(image).image;
}

/// CPU seconds of this process, all threads.
inline double cpu_seconds() {
  timespec now{};
  clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &now);
  return static_cast<double>(now.tv_sec) + 1e-9 * static_cast<double>(now.tv_nsec);
}
inline double peak_mib() {
  rusage usage{};
  getrusage(RUSAGE_SELF, &usage);
  return static_cast<double>(usage.ru_maxrss) / 1024.0;
}

/// One line: `seconds` are CPU seconds from the image in memory to the modulus.
inline void print_line(const std::string& what, long cells, long unknowns, double modulus, double reference,
                       int iterations, double mesh_seconds, double seconds) {
  std::printf("| %s | %ld | %ld | %.5f | %+.2f %% | %d | %.2f | %.2f | %.0f |\n", what.c_str(), cells, unknowns,
              modulus, 100.0 * (modulus / reference - 1.0), iterations, mesh_seconds, seconds, peak_mib());
}
inline void print_head() {
  std::printf(
      "| peer | cells | unknowns | modulus / E | error | iterations | mesh [s] | all [s] | peak [MiB] |\n"
      "|---|---|---|---|---|---|---|---|---|\n");
}

}  // namespace peers
