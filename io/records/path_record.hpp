// SPDX-License-Identifier: GPL-3.0-or-later
/// What an analysis through time leaves on the disk while it goes on, so that one that is killed can be gone on with.
#pragma once

#include "efree/io/case/case_file.hpp"
#include "efree/io/files/output_directory.hpp"

#include <filesystem>
#include <memory>
#include <optional>
#include <string>

namespace efree {

namespace internal {
class Unfinished;
}

/// Writes a checkpoint of a case, bit for bit, with a sum that tells damage; what was in the file stays until the new
/// one is complete. Throws InputError if the file cannot be written.
template <int Dim> void write_checkpoint(const std::filesystem::path& file, const Checkpoint<Dim>& there, CaseMark of);
/// Throws InputError for a file that cannot be read, is no checkpoint (of this version), is damaged, or belongs to
/// another case; if its steps were others, the next one is that of the path's options.
template <int Dim> Checkpoint<Dim> read_checkpoint(const std::filesystem::path& file, CaseMark of);

/// Keeps `path.state` (the last checkpoint), `history.csv` and, where the case asks for them, `fields_0001.vtu`, ...
/// with `fields.pvd` in the folder `unfinished` of an output directory, up to date after every step whenever the run is
/// killed. A run that ends adds them to its results. One run at a time.
template <int Dim> class PathRecord {
 public:
  /// Refers to the case. Nothing is written yet.
  PathRecord(std::filesystem::path directory, const Case<Dim>& analysis);
  ~PathRecord();

  /// Whether a run was killed here.
  bool is_unfinished() const;
  /// The last checkpoint of the run that was killed here, or of the one that ended. Throws InputError if there is none,
  /// if it cannot be read (read_checkpoint), or another run goes on here.
  Checkpoint<Dim> resume();
  /// For Steps::done. Throws InputError if files cannot be written, or another run goes on here.
  void keep(const Checkpoint<Dim>& there, const Result<Dim>& so_far);
  /// Adds path.state, fields of steps and their list to the results; older ones go. Call `forget` once these are in
  /// place.
  void finish(OutputDirectory& out, const Result<Dim>& result) const;
  /// Removes the folder.
  void forget();

 private:
  void take_back(const Checkpoint<Dim>& there) const;

  std::filesystem::path directory_;
  std::unique_ptr<internal::Unfinished> unfinished_;
  std::filesystem::path folder_;
  const Case<Dim>& case_;
  int steps_ = 0;  ///< in history.csv
};

}  // namespace efree
