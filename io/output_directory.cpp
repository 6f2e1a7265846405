// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/io/output_directory.hpp"

#include "efree/core/error.hpp"

#include <fmt/format.h>
#include <unistd.h>

namespace efree {
namespace fs = std::filesystem;

OutputDirectory::OutputDirectory(fs::path directory) : directory_(std::move(directory)) {
  if (directory_.empty()) throw InputError("the name of the output directory is empty, expected a directory");
  std::error_code error;
  const fs::path absolute = fs::absolute(directory_).lexically_normal();
  for (fs::path part = absolute; !fs::exists(part, error) && part != part.parent_path(); part = part.parent_path())
    if (!part.filename().empty()) created_ = part;
  fs::create_directories(absolute, error);
  if (error)
    throw InputError(fmt::format("cannot create the output directory {}: {}", directory_.string(), error.message()));
  staging_ = absolute / fmt::format(".efree-{}", getpid());
  fs::create_directory(staging_, error);
  if (error)
    throw InputError(fmt::format("cannot write to the output directory {}: {}", directory_.string(), error.message()));
}

OutputDirectory::~OutputDirectory() {
  discard();
}

void OutputDirectory::discard() {
  const std::lock_guard lock(mutex_);
  std::error_code ignored;  // nothing can be done about it here
  fs::remove_all(staging_, ignored);
  if (created_.empty()) return;
  const fs::path above = created_.parent_path();
  for (fs::path part = fs::absolute(directory_).lexically_normal(); part != above; part = part.parent_path())
    fs::remove(part, ignored);  // only if it is empty
}

void OutputDirectory::commit() {
  const std::lock_guard lock(mutex_);
  try {
    created_.clear();
    for (const std::string& name : superseded_) fs::remove(directory_ / name);
    for (const auto& entry : fs::directory_iterator(staging_))
      fs::rename(entry.path(), directory_ / entry.path().filename());
  } catch (const fs::filesystem_error& error) {
    throw InputError(
        fmt::format("cannot write to the output directory {}: {}", directory_.string(), error.code().message()));
  }
}

}  // namespace efree
