// SPDX-License-Identifier: GPL-3.0-or-later
/// [output] pictures.
#pragma once

#include "efree/io/case/internal/section.hpp"
#include "efree/io/case/picture_options.hpp"

#include <string>
#include <vector>

namespace efree::internal {

/// What pictures of a case may show.
struct PictureChoices {
  std::vector<std::string> fields{};      ///< names; empty: they are not known yet
  std::vector<std::string> load_cases{};  ///< names
  bool solid = false;                     ///< in space
  bool at_rest = false;                   ///< of statics: displacements are drawn by a factor, of one load case
};

/// The pictures of [output], which are none if it does not name any; names of their own, one apiece. Throws InputError
/// beginning with "file:line: ".
std::vector<PictureOptions> read_pictures(const Section& output, const PictureChoices& choices);

}  // namespace efree::internal
