// SPDX-License-Identifier: GPL-3.0-or-later
/// Effective properties as a chart.
#pragma once

#include "efree/analysis/effective.hpp"
#include "efree/io/files/output_directory.hpp"

#include <string>

namespace efree {

/// directions.svg and directions.png: Young's modulus (conductivity: n . K n) by direction in the planes xy, xz and yz,
/// in the plane in that, by gnuplot. Returns an empty string, or why there is no chart. Throws InputError if a file
/// cannot be written.
std::string draw_directions(OutputDirectory& out, EffectiveProperty property, const EffectiveResult& result);

}  // namespace efree
