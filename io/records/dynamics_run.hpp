// SPDX-License-Identifier: GPL-3.0-or-later
/// Files of a run of explicit dynamics, complete also when it is killed.
#pragma once

#include "efree/io/case/case_file.hpp"
#include "efree/io/files/output_directory.hpp"
#include "efree/io/records/contact_forces.hpp"
#include "efree/io/records/dynamics_record.hpp"

#include <array>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <vector>

namespace efree {

namespace internal {
class Unfinished;
}

/// Reads the state of DynamicsSettings::state_start, if the case has one. Throws InputError, beginning with its place
/// in the case file, for one that cannot be read, is damaged, of another version or dimension.
template <int Dim> void read_state_start(DynamicsCase<Dim>& dynamics_case);

/// Keeps a DynamicsRecord with pictures and `dynamics.state`, the last checkpoint, in the folder `unfinished` of an
/// output directory. A run that ends adds them to its results. One run at a time.
template <int Dim> class DynamicsRun {
 public:
  /// Refers to the case. Nothing is written yet.
  DynamicsRun(std::filesystem::path directory, const DynamicsCase<Dim>& dynamics_case, bool pictures);
  ~DynamicsRun();

  /// Whether a run was killed here.
  bool is_unfinished() const;
  /// Restores the model from the last checkpoint: of the run that was killed here, or of one that ended. Throws
  /// InputError if there is none, it is of another case (but for [time] and [output]), is damaged, or another run goes
  /// on here.
  void resume(DynamicsModel<Dim>& model);
  /// Throws InputError, beginning with its place in the case file, for a picture of a field that the points of the
  /// model do not have.
  void check_pictures(const DynamicsModel<Dim>& model) const;
  /// For DynamicsObserver. All throw InputError where files cannot be written.
  void add_bodies(const FineMesh<Dim>& mesh);
  void add_history_line(const DynamicsModel<Dim>& model);
  void add_frame(const DynamicsModel<Dim>& model);
  void write_checkpoint(const DynamicsModel<Dim>& model);
  /// Whether something of this run has been written.
  bool has_begun() const { return record_.has_value(); }
  /// Adds all files to the results, in place of older ones, and the animation if one is wanted. Call
  /// `remove_unfinished` once these are in place. Returns why there is no animation, or an empty string.
  std::string finish(OutputDirectory& out) const;
  void remove_unfinished();
  /// By the lines of the history so far.
  const ContactForces<Dim>& contact_forces() const { return contact_forces_; }

 private:
  void begin();
  void draw(const DynamicsModel<Dim>& model, Index frame);
  void remove_other_pictures();

  std::filesystem::path directory_;
  const DynamicsCase<Dim>& case_;
  std::vector<PictureOptions> pictures_;       ///< of every frame
  std::vector<std::array<double, 2>> ranges_;  ///< of their colours so far, by picture
  std::unique_ptr<internal::Unfinished> unfinished_;
  std::optional<DynamicsRecord<Dim>> record_;
  ContactForces<Dim> contact_forces_;
};

}  // namespace efree
