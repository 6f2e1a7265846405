// SPDX-License-Identifier: GPL-3.0-or-later
/// What runs leave on the disk while they go on: files that are whole whenever the run is killed.
#pragma once

#include "efree/io/case/case_file.hpp"
#include "efree/io/files/internal/cannot_write.hpp"

#include <filesystem>
#include <initializer_list>
#include <optional>
#include <string>
#include <string_view>
#include <utility>

namespace efree::internal {

/// The folder `unfinished` of an output directory, of one run at a time.
class Unfinished {
 public:
  /// Nothing is written yet.
  explicit Unfinished(const std::filesystem::path& directory) : folder_(directory / "unfinished") {}
  ~Unfinished();
  Unfinished(const Unfinished&) = delete;
  Unfinished& operator=(const Unfinished&) = delete;

  const std::filesystem::path& folder() const { return folder_; }
  /// From now on the folder is there, and this run's. Throws InputError if it cannot be made, or another run has it.
  void begin();
  /// Removes the folder if it is this run's.
  void forget();

 private:
  std::filesystem::path folder_;
  int lock_ = -1;
};

/// Writes a file beside, by write(path), then puts it in place.
template <class Write> void replace(const std::filesystem::path& file, const Write& write);

/// The same file at another place, without its bytes where the file system can do that. Throws InputError.
void link(const std::filesystem::path& from, const std::filesystem::path& to);

/// Writes a checkpoint: what is packed, part by part, after the version, the dimension and the case that it is of, with
/// a sum that tells damage; what was in the file stays until the new one is complete. `kind` is how such files begin.
/// Throws InputError if the file cannot be written.
void write_sealed(const std::filesystem::path& file, std::string_view kind, int dimension, CaseMark of,
                  std::initializer_list<std::string_view> packed);
/// What such a file says.
struct Sealed {
  std::string file;       ///< all of it
  std::size_t begin = 0;  ///< of what was packed
  CaseMark of{};

  std::string_view packed() const { return std::string_view(file).substr(begin); }
};
/// Throws InputError for a file that cannot be read, is of another kind,
/// version, dimension or case (CaseMark::what; of any, if there is none), or is damaged.
Sealed read_sealed(const std::filesystem::path& file, std::string_view kind, int dimension,
                   const std::optional<CaseMark>& of);
/// Throws InputError that says so of a file.
[[noreturn]] void is_damaged(const std::filesystem::path& file);

template <class Write> void replace(const std::filesystem::path& file, const Write& write) {
  std::filesystem::path part = file;
  part += ".part";
  std::error_code error;
  try {
    write(part);
  } catch (...) {
    std::filesystem::remove(part, error);
    throw;
  }
  std::filesystem::rename(part, file, error);
  if (error) cannot_write(file);
}

}  // namespace efree::internal
