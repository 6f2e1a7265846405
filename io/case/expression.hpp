// SPDX-License-Identifier: GPL-3.0-or-later
/// Fields written as text: "sin(pi*x) + y^2".
#pragma once

#include "efree/core/types.hpp"

#include <array>
#include <memory>
#include <optional>
#include <string>
#include <vector>

namespace efree {

/// Turns text into fields (muParser). Variables x, y(, z); constants pi, e; operators + - * / ^ < > <= >= == != && ||
/// and condition ? a : b; functions sin cos tan asin acos atan atan2 sinh cosh tanh asinh acosh atanh sqrt exp ln log
/// (both to base e) log2 log10 abs sign rint min max sum avg; and names given to define(). Fields may be copied and
/// called from several threads at once.
template <int Dim> class Expressions {
 public:
  Expressions();
  /// Gives a name to an expression that later ones may use; it may depend on position and on names defined before.
  /// `where` begins every message about it. Throws InputError for a name that is taken or no identifier, and as
  /// field().
  void define(const std::string& name, const std::string& text, const std::string& where = {});
  /// Gives a name to a field that is no expression. Throws InputError for a name that is taken or no identifier.
  void define(const std::string& name, ScalarField<Dim> given);
  /// Calls a time t, which messages about values that are not finite then name. Throws InputError if t is taken.
  void at_time(double t);
  /// The same at another time; what has been compiled is shared. Throws InputError unless at_time() was called.
  Expressions at_another_time(double t) const;
  /// Calls the first coordinate of where fields are asked for the time t; messages then say that instead of a point.
  void at_any_time();
  /// The time t is what the clock says when a field is asked; messages say it.
  void at_clock(std::shared_ptr<const double> clock);
  /// Keeps a name from being defined; expressions that use it are refused with this reason, by themselves or through
  /// definitions.
  void refuse(const std::string& name, const std::string& why);

  /// The field described by `text`. Throws InputError naming expression, position in it and what is wrong; calling the
  /// field throws InputError naming expression, point (if it depends on that) and time where the value is not finite.
  ScalarField<Dim> field(const std::string& text, const std::string& where = {}) const;

  /// Whether it depends on the position. Throws like field().
  bool varies(const std::string& text, const std::string& where = {}) const;

  /// Whether it depends on what was given that name, by itself or through definitions. Throws like field().
  bool uses(const std::string& name, const std::string& text, const std::string& where = {}) const;

  /// The same for as many components as a vector or a symmetric tensor has, which share what they have in common.
  template <std::size_t Size> std::function<Eigen::Matrix<double, static_cast<int>(Size), 1>(const Vec<Dim>&)> fields(
      const std::array<std::string, Size>& texts, const std::string& where = {}) const;

 private:
  /// One of text, given and refused; the time has none.
  struct Definition {
    std::string name, text{};
    ScalarField<Dim> given{};
    std::string refused{};
  };
  struct Compiled;
  void add(Definition definition);
  void require_free(const std::string& name, const std::string& where) const;

  std::vector<Definition> definitions_;
  std::shared_ptr<Compiled> compiled_;  ///< with these definitions; shared by copies
  std::optional<double> time_{};
  bool runs_ = false;  ///< points are times
  std::shared_ptr<const double> clock_{};
};

}  // namespace efree
