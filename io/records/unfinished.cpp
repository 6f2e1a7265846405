// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/io/records/internal/unfinished.hpp"

#include "efree/core/error.hpp"
#include "efree/core/internal/fingerprint.hpp"
#include "efree/core/packer.hpp"
#include "efree/io/records/writers.hpp"

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

void write_sealed(const fs::path& file, std::string_view kind, int dimension, CaseMark of,
                  std::initializer_list<std::string_view> packed) {
  Packer pack;
  std::string by = version();
  pack(by), pack(dimension), pack(of.what), pack(of.how);
  const std::string header = std::string(kind) + std::move(pack).bytes();
  replace(file, [&](const fs::path& part) {
    std::ofstream stream(part, std::ios::binary);
    Fingerprint sum;
    const auto put = [&](std::string_view bytes) {
      sum.add(bytes);
      stream.write(bytes.data(), static_cast<std::streamsize>(bytes.size()));
    };
    put(header);
    for (const std::string_view bytes : packed) put(bytes);
    const std::uint64_t value = sum.value();
    stream.write(reinterpret_cast<const char*>(&value), sizeof value);
    if (!stream.flush()) cannot_write(file);
  });
}

Sealed read_sealed(const fs::path& file, std::string_view kind, int dimension, const std::optional<CaseMark>& of) {
  const auto fail = [&](const std::string& why) { throw InputError(fmt::format("{}: {}", file.string(), why)); };
  // The run of the case may begin anew instead; one that starts from any other may not.
  const auto damaged = [&] { of ? is_damaged(file) : fail("the file is damaged"); };
  Sealed result;
  std::string& bytes = result.file;
  std::error_code unknown;
  const std::uintmax_t size = fs::file_size(file, unknown);
  if (unknown) fail("the steps of an earlier run cannot be read");
  bytes.resize(size);
  std::ifstream stream(file, std::ios::binary);
  stream.read(bytes.data(), static_cast<std::streamsize>(bytes.size()));
  if (!stream) fail("the steps of an earlier run cannot be read");
  if (!bytes.starts_with(kind)) fail("expected the steps of an earlier run of efree");
  std::uint64_t sum = 0;
  if (bytes.size() < kind.size() + sizeof sum) damaged();
  std::memcpy(&sum, bytes.data() + bytes.size() - sizeof sum, sizeof sum);
  bytes.resize(bytes.size() - sizeof sum);
  if (sum != Fingerprint().add(bytes).value()) damaged();
  Unpacker unpack(std::string_view(bytes).substr(kind.size()));
  std::string by;
  int its_dimension = 0;
  try {
    unpack(by);
    if (by == version()) unpack(its_dimension), unpack(result.of.what), unpack(result.of.how);
  } catch (const InputError&) {
    damaged();
  }
  if (by != version())
    fail(fmt::format("these steps are of efree {}, and this is {}{}", by, version(),
                     of ? ": run without --resume" : ""));
  if (!of && its_dimension != dimension)
    fail(fmt::format("this run is {}, expected one {}", its_dimension == 2 ? "in the plane" : "in space",
                     dimension == 2 ? "in the plane" : "in space"));
  if (of && (its_dimension != dimension || result.of.what != of->what))
    fail(
        "these steps are of another case: the case file, or the geometry's, has changed by more than steps of [time]; "
        "run without --resume");
  result.begin = bytes.size() - unpack.rest().size();
  return result;
}

}  // namespace efree::internal
