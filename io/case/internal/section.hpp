// SPDX-License-Identifier: GPL-3.0-or-later
/// Tables of a TOML file, read with checks: whatever is wrong is said with file and line.
#pragma once

#include "efree/core/error.hpp"
#include "efree/core/internal/unit_vector.hpp"
#include "efree/core/types.hpp"

#include <toml++/toml.h>
#include <array>
#include <limits>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace efree::internal {

/// An interval; ends belong to it only where closed.
struct Interval {
  static constexpr double infinity = std::numeric_limits<double>::infinity();
  double low = -infinity, high = infinity;
  bool low_closed = false, high_closed = false;

  bool contains(double v) const { return (low_closed ? v >= low : v > low) && (high_closed ? v <= high : v < high); }
  std::string text() const;
};
inline constexpr Interval any_number{}, positive{0.0}, not_negative{0.0, Interval::infinity, true};

/// "did you mean ...?" or all there is to choose from.
std::string suggestion(std::string_view wrong, const std::vector<std::string_view>& known);

/// One table of the file. Unknown keys are rejected on construction, values when they are read. All members throw
/// InputError that begins with "file:line: ".
class Section {
 public:
  using Keys = std::vector<std::string_view>;

  /// `label` is how messages call it; an empty `keys` allows any key.
  Section(const toml::table& table, std::string label, std::string file, Keys keys);

  bool has(std::string_view key) const { return table_->contains(key); }
  std::string where() const { return where(*table_); }
  std::string where(std::string_view key) const { return has(key) ? where(*table_->get(key)) : where(); }
  std::string where(const toml::node& node) const;
  const toml::table& table() const { return *table_; }
  const std::string& label() const { return label_; }
  [[noreturn]] void fail(std::string_view key, const std::string& message) const;

  bool is_table(std::string_view key) const { return has(key) && table_->get(key)->is_table(); }
  /// The table under `key`, or an empty one.
  Section section(std::string_view key, Keys keys) const;
  /// The same, but it must be there.
  Section required_section(std::string_view key, Keys keys) const;
  /// A table in the array under `key`.
  Section section(const toml::table& table, std::string_view key, Keys keys) const {
    return {table, label_of(key), file_, std::move(keys)};
  }
  /// The tables of an array [[key]].
  std::vector<Section> sections(std::string_view key, const Keys& keys) const;

  double number(std::string_view key, const Interval& range, std::optional<double> fallback = {}) const;
  std::int64_t integer(std::string_view key, std::int64_t low, std::int64_t high,
                       std::optional<std::int64_t> fallback = {}) const;
  bool boolean(std::string_view key, bool fallback) const;
  /// true, false, or nothing for "auto".
  std::optional<bool> switch_or_auto(std::string_view key) const;
  std::string text(std::string_view key, std::optional<std::string> fallback = {}) const;
  std::vector<std::string> texts(std::string_view key) const;
  template <class Value> Value choice(std::string_view key,
                                      const std::vector<std::pair<std::string_view, Value>>& values,
                                      std::optional<Value> fallback) const {
    if (!has(key) && fallback) return *fallback;
    const std::string chosen = text(key);
    for (const auto& [name, value] : values)
      if (name == chosen) return value;
    std::vector<std::string_view> names;
    for (const auto& entry : values) names.push_back(entry.first);
    reject_choice(key, chosen, names);
  }

  /// An array of numbers of any length, or one number.
  std::vector<double> numbers(std::string_view key, const Interval& range) const;
  /// An array of pairs of numbers: [[a, b], [c, d], ...].
  std::vector<std::array<double, 2>> pairs(std::string_view key) const;
  /// make(x, y) of the columns of a table [[x, y], ...]. An InputError that it throws gets the place of the key.
  template <class Make> auto tabulated(std::string_view key, const Make& make) const {
    std::vector<double> x, y;
    for (const auto& [a, b] : pairs(key)) {
      x.push_back(a);
      y.push_back(b);
    }
    try {
      return make(std::move(x), std::move(y));
    } catch (const InputError& error) {
      fail(key, std::string(key) + ": " + error.what());
    }
  }
  template <int Dim> Vec<Dim> point(std::string_view key) const { return point<Dim>(need(key), key); }
  /// The unit vector along one of any length but zero, however large or small.
  template <int Dim> Vec<Dim> direction(std::string_view key) const {
    const Vec<Dim> along = point<Dim>(key);
    if (along.isZero(0.0)) fail(key, std::string(key) + " is zero, expected a direction");
    return unit_vector<Dim>(along);
  }
  /// Two opposite corners: [[x0, y0], [x1, y1]].
  template <int Dim> std::array<Vec<Dim>, 2> corners(std::string_view key) const {
    const toml::array& both = array(need(key), key, 2, "points");
    return {point<Dim>(*both.get(0), key), point<Dim>(*both.get(1), key)};
  }

  /// A number or an expression as text: text as it stands, numbers in full precision.
  std::string expression(std::string_view key) const { return expression(need(key), key); }
  std::string expression(const toml::node& node, std::string_view key) const;
  /// An array of numbers or expressions; all as text.
  template <std::size_t Size> std::array<std::string, Size> expressions(std::string_view key) const {
    const toml::array& entries = array(need(key), key, Size, "numbers or expressions");
    std::array<std::string, Size> result;
    for (std::size_t i = 0; i < Size; ++i) result[i] = expression(*entries.get(i), key);
    return result;
  }

 private:
  std::string inside() const { return label_.empty() ? "" : " in " + label_; }
  std::string label_of(std::string_view key) const;
  [[noreturn]] void reject(const toml::node& node, std::string_view key, const std::string& expected) const;
  [[noreturn]] void reject_choice(std::string_view key, const std::string& chosen, const Keys& names) const;
  const toml::node& need(std::string_view key) const;
  const toml::array& array(const toml::node& node, std::string_view key, std::size_t size, const char* of) const;
  double number(const toml::node& node, std::string_view key, const Interval& range) const;
  std::string text(const toml::node& node, std::string_view key) const;
  template <int Dim> Vec<Dim> point(const toml::node& node, std::string_view key) const {
    const toml::array& coordinates = array(node, key, Dim, "numbers");
    Vec<Dim> x;
    for (int i = 0; i < Dim; ++i) x[i] = number(*coordinates.get(static_cast<std::size_t>(i)), key, any_number);
    return x;
  }

  const toml::table* table_;
  std::string label_, file_;
};

/// The whole file. Throws InputError with file and line for one that cannot be read or is no TOML.
toml::table parse_toml(const std::string& file);

}  // namespace efree::internal
