// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/io/internal/unfinished.hpp"

#include "efree/core/error.hpp"
#include "efree/core/internal/fingerprint.hpp"
#include "efree/core/internal/packer.hpp"
#include "efree/io/writers.hpp"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/file.h>
#include <unistd.h>
#include <bit>
#include <cerrno>
#include <cstring>
#include <fstream>

namespace efree::internal {
namespace fs = std::filesystem;

static_assert(std::endian::native == std::endian::little, "checkpoints are written as they are in memory");

Unfinished::~Unfinished() {
  if (lock_ >= 0) close(lock_);
}

void Unfinished::begin() {
  if (lock_ >= 0) return;
  std::error_code error;
  fs::create_directory(folder_, error);
  lock_ = open(folder_.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC);
  if (error || lock_ < 0) cannot_write(folder_);
  if (flock(lock_, LOCK_EX | LOCK_NB) != 0 && errno == EWOULDBLOCK) {
    close(std::exchange(lock_, -1));
    throw InputError(fmt::format("{}: another run goes on here, expected another --out", folder_.string()));
  }
}

void Unfinished::forget() {
  if (lock_ < 0) return;
  std::error_code ignored;
  fs::remove_all(folder_, ignored);
  close(std::exchange(lock_, -1));
}

void link(const fs::path& from, const fs::path& to) {
  std::error_code error;
  fs::create_hard_link(from, to, error);
  if (error) fs::copy_file(from, to, fs::copy_options::overwrite_existing, error);
  if (error) cannot_write(to);
}

void is_damaged(const fs::path& file) {
  throw InputError(fmt::format("{}: the file is damaged: run without --resume", file.string()));
}

void write_sealed(const fs::path& file, std::string_view kind, int dimension, CaseMark of, std::string packed) {
  Packer pack;
  std::string by = version();
  pack(by), pack(dimension), pack(of.what), pack(of.how), pack(packed);
  std::string bytes = std::string(kind) + std::move(pack).bytes();
  const std::uint64_t sum = Fingerprint().add(bytes).value();
  bytes.append(reinterpret_cast<const char*>(&sum), sizeof sum);
  replace(file, [&](const fs::path& part) {
    std::ofstream stream(part, std::ios::binary);
    stream << bytes;
    if (!stream.flush()) cannot_write(file);
  });
}

std::pair<std::string, CaseMark> read_sealed(const fs::path& file, std::string_view kind, int dimension, CaseMark of) {
  const auto fail = [&](const std::string& why) { throw InputError(fmt::format("{}: {}", file.string(), why)); };
  std::ifstream stream(file, std::ios::binary);
  const std::string bytes(std::istreambuf_iterator<char>(stream), {});
  if (!stream) fail("the steps of an earlier run cannot be read");
  if (!bytes.starts_with(kind)) fail("expected the steps of an earlier run of efree");
  std::uint64_t sum = 0;
  if (bytes.size() < kind.size() + sizeof sum) is_damaged(file);
  const std::string_view summed(bytes.data(), bytes.size() - sizeof sum);
  std::memcpy(&sum, summed.end(), sizeof sum);
  if (sum != Fingerprint().add(summed).value()) is_damaged(file);
  Unpacker unpack(summed.substr(kind.size()));
  std::string by;
  int its_dimension = 0;
  CaseMark its;
  std::string packed;
  try {
    unpack(by);
    if (by == version()) unpack(its_dimension), unpack(its.what), unpack(its.how), unpack(packed);
  } catch (const InputError&) {
    is_damaged(file);
  }
  if (by != version())
    fail(fmt::format("these steps are of efree {}, and this is {}: run without --resume", by, version()));
  if (its_dimension != dimension || its.what != of.what)
    fail(
        "these steps are of another case: the case file, or the geometry's, has changed by more than steps of [time]; "
        "run without --resume");
  if (!unpack.empty()) is_damaged(file);
  return {std::move(packed), its};
}

}  // namespace efree::internal
