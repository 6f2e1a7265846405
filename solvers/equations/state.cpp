// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/core/error.hpp"
#include "efree/solvers/equations/equations.hpp"

#include <fmt/format.h>
#include <array>
#include <bit>
#include <cstdint>
#include <fstream>
#include <type_traits>

namespace efree {
namespace {

static_assert(std::endian::native == std::endian::little, "states are written as they are in memory");

constexpr std::array<char, 16> mark{'e', 'f', 'r', 'e', 'e', ' ', 's', 't', 'a', 't', 'e', ' ', '1', '\n', '\0', '\0'};

/// What precedes the two vectors.
struct Head {
  std::array<char, 16> mark;
  std::int64_t coefficients, remembered;
  double time, dt, factor;
};
static_assert(std::is_trivially_copyable_v<Head> && sizeof(Head) == 56);

std::streamsize bytes(const Vector& values) {
  return static_cast<std::streamsize>(sizeof(double)) * values.size();
}

}  // namespace

void write_state(const State& state, const std::filesystem::path& file) {
  std::filesystem::path part = file;
  part += ".part";
  {
    std::ofstream out(part, std::ios::binary);
    const Head head{mark, state.u.size(), state.history.size(), state.time, state.dt, state.factor};
    out.write(reinterpret_cast<const char*>(&head), sizeof head);
    for (const Vector* values : {&state.u, &state.history})
      out.write(reinterpret_cast<const char*>(values->data()), bytes(*values));
    out.close();
    if (!out) {
      std::error_code ignored;
      std::filesystem::remove(part, ignored);
      throw InputError(fmt::format("{}: the state cannot be written", file.string()));
    }
  }
  std::error_code error;
  std::filesystem::rename(part, file, error);
  if (error) throw InputError(fmt::format("{}: the state cannot be written: {}", file.string(), error.message()));
}

State read_state(const std::filesystem::path& file) {
  std::error_code error;
  const auto size = std::filesystem::file_size(file, error);
  std::ifstream in(file, std::ios::binary);
  if (error || !in) throw InputError(fmt::format("{}: the state cannot be read", file.string()));
  Head head{};
  in.read(reinterpret_cast<char*>(&head), sizeof head);
  if (!in || head.mark != mark) throw InputError(fmt::format("{}: expected a state of efree", file.string()));
  const auto most = static_cast<std::int64_t>(size / sizeof(double));
  const bool plausible = head.coefficients >= 0 && head.remembered >= 0 && head.coefficients <= most &&
                         head.remembered <= most &&
                         size == sizeof head + sizeof(double) * (head.coefficients + head.remembered);
  if (!plausible)
    throw InputError(fmt::format("{}: a state of {} + {} numbers is not {} bytes long: the file is damaged",
                                 file.string(), head.coefficients, head.remembered, size));
  State state{Vector(head.coefficients), Vector(head.remembered), head.time, head.dt, head.factor};
  for (Vector* values : {&state.u, &state.history}) in.read(reinterpret_cast<char*>(values->data()), bytes(*values));
  if (!in) throw InputError(fmt::format("{}: the state cannot be read", file.string()));
  return state;
}

}  // namespace efree
