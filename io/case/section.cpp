// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/io/case/internal/section.hpp"

#include "efree/core/error.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <algorithm>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <sstream>

namespace efree::internal {
namespace {

/// Number of letters to insert, remove or replace (Levenshtein 1966).
std::size_t edit_distance(std::string_view a, std::string_view b) {
  std::vector<std::size_t> row(b.size() + 1);
  for (std::size_t j = 0; j <= b.size(); ++j) row[j] = j;
  for (std::size_t i = 1; i <= a.size(); ++i) {
    std::size_t diagonal = row[0]++;
    for (std::size_t j = 1; j <= b.size(); ++j) {
      const std::size_t replaced = diagonal + (a[i - 1] != b[j - 1]);
      diagonal = row[j];
      row[j] = std::min({replaced, row[j] + 1, row[j - 1] + 1});
    }
  }
  return row.back();
}

std::string kind_of(const toml::node& node) {
  std::ostringstream text;
  text << node.type();
  return text.str();
}

std::string shown(const toml::node& node) {
  if (const toml::array* array = node.as_array()) return fmt::format("an array of {}", array->size());
  if (const auto* number = node.as_floating_point()) return fmt::format("{}", number->get());
  if (!node.is_value()) return fmt::format("a {}", kind_of(node));
  std::ostringstream value;
  node.visit([&](const auto& v) {
    if constexpr (toml::is_value<decltype(v)>) value << v;
  });
  return value.str();
}

}  // namespace

std::string Interval::text() const {
  if (high == infinity)
    return low == -infinity ? "a finite number" : fmt::format("a number {} {}", low_closed ? ">=" : ">", low);
  return fmt::format("a number in {}{}, {}{}", low_closed ? '[' : '(', low, high, high_closed ? ']' : ')');
}

std::string suggestion(std::string_view wrong, const std::vector<std::string_view>& known) {
  const auto nearest =
      *std::ranges::min_element(known, {}, [&](std::string_view name) { return edit_distance(wrong, name); });
  if (edit_distance(wrong, nearest) <= std::max<std::size_t>(2, nearest.size() / 3))
    return fmt::format("did you mean \"{}\"?", nearest);
  return fmt::format("expected one of {}", fmt::join(known, ", "));
}

Section::Section(const toml::table& table, std::string label, std::string file, Keys keys)
    : table_(&table), label_(std::move(label)), file_(std::move(file)) {
  if (keys.empty()) return;
  for (const auto& [key, node] : table)
    if (std::ranges::find(keys, key.str()) == keys.end())
      throw InputError(
          fmt::format("{}: unknown key \"{}\"{}; {}", where(node), key.str(), inside(), suggestion(key.str(), keys)));
}

std::string Section::where(const toml::node& node) const {
  const auto line = node.source().begin.line;
  return line ? fmt::format("{}:{}", file_, line) : file_;
}

void Section::fail(std::string_view key, const std::string& message) const {
  throw InputError(fmt::format("{}: {}", where(key), message));
}

std::string Section::label_of(std::string_view key) const {
  if (label_.starts_with('[') && !label_.starts_with("[["))
    return fmt::format("[{}.{}]", label_.substr(1, label_.size() - 2), key);
  return fmt::format("[{}]", key);
}

Section Section::section(std::string_view key, Keys keys) const {
  static const toml::table empty;
  if (!has(key)) return {empty, label_of(key), file_, std::move(keys)};
  const toml::table* table = table_->get(key)->as_table();
  if (!table) fail(key, fmt::format("{} is {}, expected a table {}", key, shown(*table_->get(key)), label_of(key)));
  return {*table, label_of(key), file_, std::move(keys)};
}

Section Section::required_section(std::string_view key, Keys keys) const {
  if (!has(key)) throw InputError(fmt::format("{}: section {} is missing", file_, label_of(key)));
  return section(key, std::move(keys));
}

std::vector<Section> Section::sections(std::string_view key, const Keys& keys) const {
  std::vector<Section> result;
  if (!has(key)) return result;
  const toml::array* array = table_->get(key)->as_array();
  const std::string label = fmt::format("[{}]", label_of(key));
  const auto refuse = [&] {
    fail(key, fmt::format("{} must be written {}, once for each entry, or as an array of tables", key, label));
  };
  if (!array) refuse();
  for (const toml::node& node : *array) {
    if (!node.is_table()) refuse();
    result.emplace_back(*node.as_table(), label, file_, keys);
  }
  return result;
}

double Section::number(std::string_view key, const Interval& range, std::optional<double> fallback) const {
  if (!has(key) && fallback) return *fallback;
  return number(need(key), key, range);
}

std::int64_t Section::integer(std::string_view key, std::int64_t low, std::int64_t high,
                              std::optional<std::int64_t> fallback) const {
  if (!has(key) && fallback) return *fallback;
  const toml::node& node = need(key);
  if (!node.is_integer() || *node.value<std::int64_t>() < low || *node.value<std::int64_t>() > high)
    reject(node, key,
           high == std::numeric_limits<std::int64_t>::max() ? fmt::format("an integer >= {}", low)
                                                            : fmt::format("an integer from {} to {}", low, high));
  return *node.value<std::int64_t>();
}

bool Section::boolean(std::string_view key, bool fallback) const {
  if (!has(key)) return fallback;
  const toml::node& node = need(key);
  if (!node.is_boolean()) reject(node, key, "true or false");
  return *node.value<bool>();
}

std::optional<bool> Section::switch_or_auto(std::string_view key) const {
  if (!has(key)) return {};
  const toml::node& node = need(key);
  if (node.is_boolean()) return node.value<bool>();
  if (node.value<std::string>() != "auto") reject(node, key, "true, false or \"auto\"");
  return {};
}

std::string Section::text(std::string_view key, std::optional<std::string> fallback) const {
  if (!has(key) && fallback) return *fallback;
  return text(need(key), key);
}

std::vector<std::string> Section::texts(std::string_view key) const {
  std::vector<std::string> result;
  if (!has(key)) return result;
  const toml::array* array = need(key).as_array();
  if (!array) reject(need(key), key, "an array of strings");
  for (const toml::node& node : *array) result.push_back(text(node, key));
  return result;
}

std::vector<double> Section::numbers(std::string_view key, const Interval& range) const {
  const toml::array* array = need(key).as_array();
  if (!array) return {number(need(key), key, range)};
  std::vector<double> result;
  for (const toml::node& node : *array) result.push_back(number(node, key, range));
  return result;
}

std::vector<std::array<double, 2>> Section::pairs(std::string_view key) const {
  const toml::array* all = need(key).as_array();
  if (!all || all->empty()) reject(need(key), key, "an array of pairs of numbers");
  std::vector<std::array<double, 2>> result;
  for (const toml::node& node : *all) {
    const toml::array& pair = array(node, key, 2, "numbers");
    result.push_back({number(*pair.get(0), key, any_number), number(*pair.get(1), key, any_number)});
  }
  return result;
}

std::string Section::expression(const toml::node& node, std::string_view key) const {
  if (node.is_string()) return text(node, key);
  if (!node.is_number()) reject(node, key, "a number or an expression");
  return fmt::format("{}", number(node, key, any_number));
}

void Section::reject(const toml::node& node, std::string_view key, const std::string& expected) const {
  throw InputError(fmt::format("{}: {} is {}, expected {}", where(node), key, shown(node), expected));
}

void Section::reject_choice(std::string_view key, const std::string& chosen, const Keys& names) const {
  fail(key, fmt::format("{} is \"{}\", expected \"{}\"", key, chosen, fmt::join(names, "\" or \"")));
}

const toml::node& Section::need(std::string_view key) const {
  if (!has(key)) throw InputError(fmt::format("{}: key \"{}\" is missing{}", where(), key, inside()));
  return *table_->get(key);
}

const toml::array& Section::array(const toml::node& node, std::string_view key, std::size_t size,
                                  const char* of) const {
  const toml::array* array = node.as_array();
  if (!array || array->size() != size) reject(node, key, fmt::format("an array of {} {}", size, of));
  return *array;
}

double Section::number(const toml::node& node, std::string_view key, const Interval& range) const {
  const auto value = node.is_number() ? node.value<double>() : std::nullopt;
  if (!value || !std::isfinite(*value) || !range.contains(*value)) reject(node, key, range.text());
  return *value;
}

std::string Section::text(const toml::node& node, std::string_view key) const {
  if (!node.is_string() || node.value<std::string>()->empty()) reject(node, key, "a non-empty string");
  return *node.value<std::string>();
}

toml::table parse_toml(const std::string& file) {
  if (std::filesystem::is_directory(file))
    throw InputError(fmt::format("{} is a directory, expected a case file", file));
  std::error_code unknown;
  if (!std::filesystem::exists(file, unknown)) throw InputError(fmt::format("there is no case file {}", file));
  std::ifstream stream(file, std::ios::binary);
  if (!stream) throw InputError(fmt::format("cannot read the case file {}", file));
  const std::string text(std::istreambuf_iterator<char>(stream), {});
  try {
    return toml::parse(text, file);
  } catch (const toml::parse_error& error) {
    throw InputError(fmt::format("{}:{}: {}", file, error.source().begin.line, error.description()));
  }
}

}  // namespace efree::internal
