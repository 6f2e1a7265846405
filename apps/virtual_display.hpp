// SPDX-License-Identifier: GPL-3.0-or-later
/// An X server without a screen.
#pragma once

#include <sys/types.h>

namespace efree {

/// Starts Xvfb on a display that is free and sets DISPLAY to it. Ended with this object, and with this process, however
/// it ends.
class VirtualDisplay {
 public:
  VirtualDisplay();
  ~VirtualDisplay();
  VirtualDisplay(const VirtualDisplay&) = delete;
  VirtualDisplay& operator=(const VirtualDisplay&) = delete;
  bool started() const { return started_; }

 private:
  pid_t server_ = -1;
  bool started_ = false;
};

}  // namespace efree
