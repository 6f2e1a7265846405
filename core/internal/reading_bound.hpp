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

/// Readers of damaged files may go round for ever. In a process that was made for reading (limited), while this lives,
/// the process ends by SIGPROF when it has computed for longer than a file of that length should take: `seconds`, and
/// as many again for every megabyte. Elsewhere nothing.
class ReadingTime {
 public:
  explicit ReadingTime(const std::string& file, double seconds = 20.0);
  ~ReadingTime();
  ReadingTime(const ReadingTime&) = delete;
  ReadingTime& operator=(const ReadingTime&) = delete;

  /// Whether this process was made for reading, and nobody has said how long it may take. Set before threads are made.
  static bool limited;

 private:
  bool is_set_ = false;
};

}  // namespace efree::internal
