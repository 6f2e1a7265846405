// SPDX-License-Identifier: GPL-3.0-or-later
/// Bad input of which it is known what a case file calls it.
#pragma once

#include "efree/core/error.hpp"

#include <string>
#include <utility>

namespace efree::internal {

/// Input that is wrong in one setting, "cloud.spacing" or "case" say: whoever knows where it was said puts that in
/// front of the message.
struct SettingError : InputError {
  SettingError(std::string which, const std::string& message) : InputError(message), setting(std::move(which)) {}
  std::string setting;
};

}  // namespace efree::internal
