// SPDX-License-Identifier: GPL-3.0-or-later
/// Stresses that a material may have in service. No law of a material uses them: results are compared with them.
#pragma once

namespace efree {

/// Limits of the stress of a material; those that are 0 are not given.
struct Strength {
  double yield = 0.0;     ///< of von Mises' stress [stress]
  double ultimate = 0.0;  ///< of the largest principal stress [stress]

  bool is_given() const { return yield > 0.0 || ultimate > 0.0; }
};

}  // namespace efree
