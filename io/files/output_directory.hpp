// SPDX-License-Identifier: GPL-3.0-or-later
/// Files that appear together, or not at all.
#pragma once

#include <filesystem>
#include <functional>
#include <mutex>
#include <string>
#include <vector>

namespace efree {

/// Collects files in a temporary folder inside the output directory. commit() moves them to their places; without it
/// everything is left as it was, so a run that fails overwrites nothing. Temporary folders of runs that were killed are
/// removed by the next run; one that was killed while it moved its files has the rest moved. Runs into one directory at
/// the same time commit one after the other.
class OutputDirectory {
 public:
  /// Creates the directory if need be. Throws InputError if its name is empty or it cannot be created or written to.
  explicit OutputDirectory(std::filesystem::path directory);
  ~OutputDirectory();
  OutputDirectory(const OutputDirectory&) = delete;
  OutputDirectory& operator=(const OutputDirectory&) = delete;

  /// The temporary folder: whatever lies in it is moved by commit().
  const std::filesystem::path& staging() const { return staging_; }
  /// Where to write the file of that name for now.
  std::filesystem::path file(const std::string& name) const { return staging_ / name; }
  /// Whether an earlier run has left a file of that name.
  bool has(const std::string& name) const { return std::filesystem::exists(directory_ / name); }
  /// Removes an older file of that name on commit(), for files that a run does not always write.
  void supersede(std::string name) { superseded_.push_back(std::move(name)); }
  /// The same of all older files with such names.
  void supersede_all(const std::function<bool(const std::string& name)>& is_one);
  /// Forgets what was collected so far.
  void clear();
  /// Moves the files to their places. Throws InputError if that is not possible.
  void commit();
  /// Removes the temporary folder and whatever else was created, unless all is committed; writing to it fails from then
  /// on. May be called from another thread.
  void discard();

 private:
  void unlock();

  std::filesystem::path directory_, staging_;
  std::filesystem::path created_;  ///< the topmost folder that was not there before; empty once committed
  std::vector<std::string> superseded_;
  int lock_ = -1;     ///< of the temporary folder: held as long as this run goes on
  std::mutex mutex_;  ///< commit or discard
};

}  // namespace efree
