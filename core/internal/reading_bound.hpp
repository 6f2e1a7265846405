// SPDX-License-Identifier: GPL-3.0-or-later
/// Headers of files can lie about how much there is to read.
#pragma once

#include <string>

namespace efree::internal {

/// In a process that was made for reading (own_process), while this lives, no more memory can be had than a file of
/// that length can stand for: 256 MiB and 200 times its length; what asks for more gets std::bad_alloc. Elsewhere
/// nothing.
class ReadingBound {
 public:
  explicit ReadingBound(const std::string& file);
  ~ReadingBound();
  ReadingBound(const ReadingBound&) = delete;
  ReadingBound& operator=(const ReadingBound&) = delete;

  /// Whether this process was made for reading, so that its limits are nobody else's. Set before threads are made.
  static bool own_process;

 private:
  unsigned long before_ = 0;  ///< the limit on data; 0: left as it is
};

}  // namespace efree::internal
