// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/io/files/output_directory.hpp"

#include "efree/core/error.hpp"
#include "efree/io/files/internal/cannot_write.hpp"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/file.h>
#include <unistd.h>
#include <fstream>
#include <utility>

namespace efree {
namespace fs = std::filesystem;

namespace {

constexpr std::string_view staging_prefix = ".efree-";
/// Ends the name of a temporary folder whose files are all there and are being moved.
constexpr std::string_view complete = ".complete";
/// Lists, a line each, what goes with the files of a temporary folder.
constexpr const char* superseded_list = ".superseded";

/// Locks a folder for this process, as long as the descriptor that is returned is open. -1 if another one has it (or,
/// where one waits, if the file system knows no locks).
int lock(const fs::path& folder, bool wait) {
  const int fd = open(folder.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC);
  if (fd >= 0 && flock(fd, LOCK_EX | (wait ? 0 : LOCK_NB)) == 0) return fd;
  if (fd >= 0) close(fd);
  return -1;
}

/// Holds the lock of a folder, for which it waits, while it lives.
class Turn {
 public:
  explicit Turn(const fs::path& folder) : fd_(lock(folder, true)) {}
  Turn(const Turn&) = delete;
  Turn& operator=(const Turn&) = delete;
  ~Turn() {
    if (fd_ >= 0) close(fd_);
  }

 private:
  int fd_;
};

/// Moves the files of a complete temporary folder to their places. What is moved is gone from it, so that it can be
/// done again from wherever it ended.
void move_files(const fs::path& from, const fs::path& to) {
  const fs::path list = from / superseded_list;
  {
    std::ifstream names(list);
    for (std::string name; std::getline(names, name);) fs::remove(to / name);
  }
  fs::remove(list);
  for (const auto& entry : fs::directory_iterator(from)) fs::rename(entry.path(), to / entry.path().filename());
  fs::remove_all(from);
}

/// What runs that were killed have left: nobody holds the locks of their folders.
void clear_up(const fs::path& directory) {
  std::vector<fs::path> left;
  std::error_code ignored;
  for (const auto& entry : fs::directory_iterator(directory, ignored))
    if (entry.path().filename().string().starts_with(staging_prefix) && entry.is_directory(ignored))
      left.push_back(entry.path());
  for (const fs::path& folder : left) {
    const int held = lock(folder, false);
    if (held < 0) continue;
    try {
      if (folder.filename().string().ends_with(complete)) move_files(folder, directory);
      fs::remove_all(folder);
    } catch (const fs::filesystem_error&) {
      // Its owner may have other rights; what this run has to say is not about that.
    }
    close(held);
  }
}

/// Throws InputError for a folder where a file is to be written, before any is moved.
void require_room(const fs::path& staging, const fs::path& directory) {
  std::error_code error;
  for (const auto& entry : fs::directory_iterator(staging, error))
    if (const fs::path target = directory / entry.path().filename(); fs::is_directory(target, error))
      throw InputError(fmt::format("cannot write {}: there is a folder of that name", target.string()));
}

}  // namespace

void internal::cannot_write(const fs::path& file) {
  fs::path folder = file.parent_path();
  if (folder.filename().string().starts_with(staging_prefix)) folder = folder.parent_path();
  std::error_code unknown;
  const fs::space_info space = fs::space(folder, unknown);
  constexpr std::uintmax_t hardly_any = std::uintmax_t{1} << 20U;
  throw InputError(fmt::format("cannot write {}{}{}", file.filename().string(),
                               folder.empty() ? "" : fmt::format(" into {}", folder.string()),
                               !unknown && space.available < hardly_any ? ": the disk is full" : ""));
}

OutputDirectory::OutputDirectory(fs::path directory) : directory_(std::move(directory)) {
  if (directory_.empty()) throw InputError("the name of the output directory is empty, expected a directory");
  std::error_code error;
  const fs::path absolute = fs::absolute(directory_).lexically_normal();
  for (fs::path part = absolute; !fs::exists(part, error) && part != part.parent_path(); part = part.parent_path())
    if (!part.filename().empty()) created_ = part;
  staging_ = absolute / fmt::format("{}{}", staging_prefix, getpid());
  // Another run that fails may remove the directory, as long as it is empty.
  for (int attempt = 0; attempt < 3; ++attempt) {
    fs::create_directories(absolute, error);
    if (error)
      throw InputError(fmt::format("cannot create the output directory {}: {}", directory_.string(), error.message()));
    const Turn turn(absolute);  // until it is locked, the new folder looks like one left behind
    clear_up(absolute);
    fs::create_directory(staging_, error);
    if (error) continue;
    lock_ = lock(staging_, false);
    return;
  }
  throw InputError(fmt::format("cannot write to the output directory {}: {}", directory_.string(), error.message()));
}

OutputDirectory::~OutputDirectory() {
  discard();
}

void OutputDirectory::unlock() {
  if (lock_ >= 0) close(std::exchange(lock_, -1));
}

void OutputDirectory::supersede_all(const std::function<bool(const std::string& name)>& is_one) {
  std::error_code error;
  for (const auto& entry : std::filesystem::directory_iterator(directory_, error))
    if (std::string name = entry.path().filename().string(); entry.is_regular_file(error) && is_one(name))
      supersede(std::move(name));
}

void OutputDirectory::clear() {
  std::error_code ignored;
  for (const auto& entry : fs::directory_iterator(staging_, ignored)) fs::remove_all(entry.path(), ignored);
  superseded_.clear();
}

void OutputDirectory::discard() {
  const std::lock_guard guard(mutex_);
  std::error_code ignored;  // nothing can be done about it here
  fs::remove_all(staging_, ignored);
  unlock();
  if (created_.empty()) return;
  const fs::path above = created_.parent_path();
  for (fs::path part = fs::absolute(directory_).lexically_normal(); part != above; part = part.parent_path())
    fs::remove(part, ignored);  // only if it is empty
}

void OutputDirectory::commit() {
  const std::lock_guard guard(mutex_);
  const fs::path directory = staging_.parent_path();
  const Turn turn(directory);
  require_room(staging_, directory);
  try {
    created_.clear();
    {
      std::ofstream list(staging_ / superseded_list);
      for (const std::string& name : superseded_) list << name << '\n';
      if (!list.flush()) internal::cannot_write(staging_ / superseded_list);
    }
    fs::path moving = staging_;
    moving += complete;
    fs::rename(staging_, moving);
    move_files(moving, directory);
    unlock();
  } catch (const fs::filesystem_error& error) {
    throw InputError(
        fmt::format("cannot write to the output directory {}: {}", directory_.string(), error.code().message()));
  }
}

}  // namespace efree
