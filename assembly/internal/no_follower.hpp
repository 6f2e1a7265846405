// SPDX-License-Identifier: GPL-3.0-or-later
/// Where pressures cannot follow the body.
#pragma once

#include "efree/core/internal/setting_error.hpp"

#include <fmt/format.h>
#include <string>

namespace efree::internal {

/// What the pressure that follows a part is called where settings are looked up.
inline std::string follower_on(const std::string& part) {
  return fmt::format("follower on \"{}\"", part);
}
/// Of a pressure on matter that is taken to be where it was at rest.
[[noreturn]] inline void refuse_follower(const std::string& part) {
  throw SettingError(follower_on(part),
                     fmt::format("pressure on \"{}\" follows the body: that is for materials of finite strains, "
                                 "expected one (strain = \"finite\", or a hyperelastic model) or follower = false",
                                 part));
}

}  // namespace efree::internal
