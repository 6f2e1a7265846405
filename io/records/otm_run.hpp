// SPDX-License-Identifier: GPL-3.0-or-later
/// What a run of bodies in motion leaves on the disk, also when it is killed.
#pragma once

#include "efree/io/case/otm_case.hpp"
#include "efree/io/files/output_directory.hpp"
#include "efree/io/records/otm_record.hpp"

#include <filesystem>
#include <memory>
#include <optional>
#include <string>

namespace efree {

namespace internal {
class Unfinished;
}

/// Keeps an OtmRecord with pictures and `otm.state`, the last checkpoint, in the folder `unfinished` of an output
/// directory. A run that ends adds them to its results. One run at a time.
template <int Dim> class OtmRun {
 public:
  /// Refers to the case. Nothing is written yet.
  OtmRun(std::filesystem::path directory, const OtmCase<Dim>& of, bool pictures);
  ~OtmRun();

  /// Whether a run was killed here.
  bool is_unfinished() const;
  /// Puts bodies where the run was at its last checkpoint: the one that was killed here, or one that ended.
  /// Throws InputError if there is none, it is of another case (but for [time] and [output]), is damaged, or another
  /// run goes on here.
  void resume(MovingBodies<Dim>& bodies);
  /// For MotionWatcher. All throw InputError where files cannot be written.
  void line(const MovingBodies<Dim>& bodies);
  void frame(const MovingBodies<Dim>& bodies);
  void checkpoint(const MovingBodies<Dim>& bodies);
  /// Whether something of this run has been written.
  bool has_begun() const { return record_.has_value(); }
  /// Adds all files to the results, in the place of older ones. Call `forget` once these are in place.
  void finish(OutputDirectory& out) const;
  /// Removes the folder.
  void forget();

 private:
  void begin();

  std::filesystem::path directory_;
  const OtmCase<Dim>& case_;
  bool pictures_;
  std::unique_ptr<internal::Unfinished> unfinished_;
  std::optional<OtmRecord<Dim>> record_;
};

/// Counts, energies, momenta, probes, extremes of all fields, where time went: the format is in docs/case-file.md.
/// Probes that find nothing are left out.
template <int Dim> void write_otm_result(const std::filesystem::path& file, const OtmCase<Dim>& of,
                                         const MovingBodies<Dim>& bodies, const MotionEnd& end,
                                         const std::vector<std::string>& warnings, const StageTimes& times);

/// What makes the numbers doubtful.
template <int Dim> std::vector<std::string> warnings_of(const OtmCase<Dim>& of, const MovingBodies<Dim>& bodies);

}  // namespace efree
