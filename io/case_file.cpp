// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/io/case_file.hpp"

#include "efree/core/error.hpp"
#include "efree/io/expression.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <toml++/toml.h>
#include <algorithm>
#include <array>
#include <cmath>
#include <fstream>
#include <iterator>
#include <limits>
#include <map>
#include <optional>
#include <set>
#include <sstream>

namespace efree {
namespace {

constexpr double infinity = std::numeric_limits<double>::infinity();

/// An interval; ends belong to it only where closed.
struct Interval {
  double low = -infinity, high = infinity;
  bool low_closed = false, high_closed = false;

  bool contains(double v) const { return (low_closed ? v >= low : v > low) && (high_closed ? v <= high : v < high); }
  std::string text() const {
    if (high == infinity)
      return low == -infinity ? "a finite number" : fmt::format("a number {} {}", low_closed ? ">=" : ">", low);
    return fmt::format("a number in {}{}, {}{}", low_closed ? '[' : '(', low, high, high_closed ? ']' : ')');
  }
};
constexpr Interval any_number{}, positive{0.0, infinity};

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

/// "did you mean ...?" or all there is to choose from.
std::string suggestion(std::string_view wrong, const std::vector<std::string_view>& known) {
  const auto nearest =
      *std::ranges::min_element(known, {}, [&](std::string_view name) { return edit_distance(wrong, name); });
  if (edit_distance(wrong, nearest) <= std::max<std::size_t>(2, nearest.size() / 3))
    return fmt::format("did you mean \"{}\"?", nearest);
  return fmt::format("expected one of {}", fmt::join(known, ", "));
}

std::string kind_of(const toml::node& node) {
  std::ostringstream text;
  text << node.type();
  return text.str();
}

/// One table of the file. Unknown keys are rejected on construction, values when they are read.
class Section {
 public:
  /// `label` is how messages call it; an empty `keys` allows any key.
  Section(const toml::table& table, std::string label, std::string file, std::vector<std::string_view> keys)
      : table_(&table), label_(std::move(label)), file_(std::move(file)) {
    if (keys.empty()) return;
    for (const auto& [key, node] : table)
      if (std::ranges::find(keys, key.str()) == keys.end())
        throw InputError(
            fmt::format("{}: unknown key \"{}\"{}; {}", where(node), key.str(), inside(), suggestion(key.str(), keys)));
  }

  bool has(std::string_view key) const { return table_->contains(key); }
  std::string where() const { return where(*table_); }
  std::string where(std::string_view key) const { return has(key) ? where(*table_->get(key)) : where(); }
  const toml::table& table() const { return *table_; }

  [[noreturn]] void fail(std::string_view key, const std::string& message) const {
    throw InputError(fmt::format("{}: {}", where(key), message));
  }

  /// The table under `key`, or an empty one.
  Section section(std::string_view key, std::vector<std::string_view> keys) const {
    static const toml::table empty;
    if (!has(key)) return {empty, fmt::format("[{}]", key), file_, std::move(keys)};
    const toml::table* table = table_->get(key)->as_table();
    if (!table) fail(key, fmt::format("{} is a {}, expected a table [{}]", key, kind_of(*table_->get(key)), key));
    return {*table, fmt::format("[{}]", key), file_, std::move(keys)};
  }
  /// The same, but it must be there.
  Section required_section(std::string_view key, std::vector<std::string_view> keys) const {
    if (!has(key)) throw InputError(fmt::format("{}: section [{}] is missing", file_, key));
    return section(key, std::move(keys));
  }
  /// The tables of an array [[key]].
  std::vector<Section> sections(std::string_view key, const std::vector<std::string_view>& keys) const {
    std::vector<Section> result;
    if (!has(key)) return result;
    const toml::array* array = table_->get(key)->as_array();
    if (!array) fail(key, fmt::format("{} must be written [[{}]], once for each entry", key, key));
    for (const toml::node& node : *array) {
      if (!node.is_table()) fail(key, fmt::format("{} must be written [[{}]], once for each entry", key, key));
      result.emplace_back(*node.as_table(), fmt::format("[[{}]]", key), file_, keys);
    }
    return result;
  }

  double number(std::string_view key, const Interval& range, std::optional<double> fallback = {}) const {
    if (!has(key) && fallback) return *fallback;
    return number(need(key), key, range);
  }
  std::int64_t integer(std::string_view key, std::int64_t low, std::int64_t high, std::int64_t fallback) const {
    if (!has(key)) return fallback;
    const toml::node& node = need(key);
    if (!node.is_integer() || *node.value<std::int64_t>() < low || *node.value<std::int64_t>() > high)
      fail(key, fmt::format("{} is {}, expected {}", key, shown(node),
                            high == std::numeric_limits<std::int64_t>::max()
                                ? fmt::format("an integer >= {}", low)
                                : fmt::format("an integer from {} to {}", low, high)));
    return *node.value<std::int64_t>();
  }
  std::string text(std::string_view key, std::optional<std::string> fallback = {}) const {
    if (!has(key) && fallback) return *fallback;
    return text(need(key), key);
  }
  std::vector<std::string> texts(std::string_view key) const {
    std::vector<std::string> result;
    if (!has(key)) return result;
    const toml::array* array = need(key).as_array();
    if (!array) fail(key, fmt::format("{} is {}, expected an array of strings", key, shown(need(key))));
    for (const toml::node& node : *array) result.push_back(text(node, key));
    return result;
  }
  template <class Value> Value choice(std::string_view key,
                                      const std::vector<std::pair<std::string_view, Value>>& values,
                                      std::optional<Value> fallback) const {
    if (!has(key) && fallback) return *fallback;
    const std::string chosen = text(key);
    std::vector<std::string_view> names;
    for (const auto& [name, value] : values) {
      if (name == chosen) return value;
      names.push_back(name);
    }
    fail(key, fmt::format("{} is \"{}\", expected \"{}\"", key, chosen, fmt::join(names, "\" or \"")));
  }
  /// true, false, or nothing for "auto".
  std::optional<bool> switch_or_auto(std::string_view key) const {
    if (!has(key)) return {};
    const toml::node& node = need(key);
    if (node.is_boolean()) return node.value<bool>();
    if (node.value<std::string>() != "auto")
      fail(key, fmt::format("{} is {}, expected true, false or \"auto\"", key, shown(node)));
    return {};
  }

  /// A number or an expression.
  std::string expression(std::string_view key) const { return expression(need(key), key); }
  /// An array of numbers or expressions; all as text.
  template <std::size_t Size> std::array<std::string, Size> expressions(std::string_view key) const {
    const toml::array* array = need(key).as_array();
    if (!array || array->size() != Size)
      fail(key, fmt::format("{} is {}, expected an array of {} numbers or expressions", key, shown(need(key)), Size));
    std::array<std::string, Size> result;
    for (std::size_t i = 0; i < Size; ++i) result[i] = expression(*array->get(i), key);
    return result;
  }
  Vec<2> point(std::string_view key) const {
    const toml::array* array = need(key).as_array();
    if (!array || array->size() != 2)
      fail(key, fmt::format("{} is {}, expected an array of 2 numbers", key, shown(need(key))));
    return {number(*array->get(0), key, any_number), number(*array->get(1), key, any_number)};
  }
  /// What an expression is made of: text as it stands, numbers in full precision.
  std::string expression(const toml::node& node, std::string_view key) const {
    if (node.is_string()) return text(node, key);
    if (!node.is_number()) reject(node, key, "a number or an expression");
    return fmt::format("{}", number(node, key, any_number));
  }
  std::string where(const toml::node& node) const {
    const auto line = node.source().begin.line;
    return line ? fmt::format("{}:{}", file_, line) : file_;
  }

 private:
  std::string inside() const { return label_.empty() ? "" : " in " + label_; }
  static std::string shown(const toml::node& node) {
    if (const toml::array* array = node.as_array()) return fmt::format("an array of {}", array->size());
    if (!node.is_value()) return fmt::format("a {}", kind_of(node));
    std::ostringstream value;
    node.visit([&](const auto& v) {
      if constexpr (toml::is_value<decltype(v)>) value << v;
    });
    return value.str();
  }
  [[noreturn]] void reject(const toml::node& node, std::string_view key, const std::string& expected) const {
    throw InputError(fmt::format("{}: {} is {}, expected {}", where(node), key, shown(node), expected));
  }
  const toml::node& need(std::string_view key) const {
    if (!has(key)) throw InputError(fmt::format("{}: key \"{}\" is missing{}", where(), key, inside()));
    return *table_->get(key);
  }
  double number(const toml::node& node, std::string_view key, const Interval& range) const {
    const auto value = node.is_number() ? node.value<double>() : std::nullopt;
    if (!value || !std::isfinite(*value) || !range.contains(*value)) reject(node, key, range.text());
    return *value;
  }
  std::string text(const toml::node& node, std::string_view key) const {
    if (!node.is_string() || node.value<std::string>()->empty()) reject(node, key, "a non-empty string");
    return *node.value<std::string>();
  }
  const toml::table* table_;
  std::string label_, file_;
};

toml::table parse(const std::filesystem::path& file) {
  if (std::filesystem::is_directory(file))
    throw InputError(fmt::format("{} is a directory, expected a case file", file.string()));
  std::ifstream stream(file, std::ios::binary);
  if (!stream) throw InputError(fmt::format("cannot read the case file {}", file.string()));
  const std::string text(std::istreambuf_iterator<char>(stream), {});
  try {
    return toml::parse(text, file.string());
  } catch (const toml::parse_error& error) {
    throw InputError(fmt::format("{}:{}: {}", file.string(), error.source().begin.line, error.description()));
  }
}

/// [definitions] in the order they are written: each may use those before.
Expressions<2> read_definitions(const Section& root) {
  const Section section = root.section("definitions", {});
  std::vector<std::pair<std::string, const toml::node*>> entries;
  for (const auto& [key, node] : section.table()) entries.emplace_back(key.str(), &node);
  std::ranges::sort(entries, {}, [](const auto& entry) {
    const auto& begin = entry.second->source().begin;
    return std::pair(begin.line, begin.column);
  });
  Expressions<2> expressions;
  for (const auto& [name, node] : entries)
    expressions.define(name, section.expression(*node, name), section.where(*node));
  return expressions;
}

void read_geometry(const Section& section, Case& result) {
  result.mesh_where = section.where("file");
  result.mesh_file = result.file.parent_path() / section.text("file");
  if (!std::filesystem::is_regular_file(result.mesh_file))
    section.fail("file", fmt::format("there is no file {}", result.mesh_file.string()));
  if (section.has("mesh_size") && section.has("mesh_ratio"))
    section.fail("mesh_ratio", "mesh_size and mesh_ratio say the same thing, expected one of them");
  result.mesh.size = section.number("mesh_size", positive, 0.0);
  result.mesh_ratio = section.number("mesh_ratio", {1.0, infinity, true}, 0.0);
  result.mesh.slits = section.texts("slits");
  const Section parameters = section.section("parameters", {});
  for (const auto& [key, node] : parameters.table())
    result.mesh.parameters[std::string(key.str())] = parameters.number(key.str(), any_number);
}

void read_approximation(const Section& cloud, const Section& quadrature, const Section& basis, Case& result) {
  ApproximationOptions& options = result.approximation;
  options.kind = basis.choice<BasisKind>(
      "kind", {{"mls", BasisKind::mls}, {"p1", BasisKind::p1}, {"p2", BasisKind::p2}}, options.kind);
  options.order = static_cast<int>(basis.integer("order", 1, 2, options.order));

  options.spacing = cloud.number("spacing", positive, 0.0);
  if (options.spacing == 0.0 && options.kind == BasisKind::mls)
    cloud.fail("spacing", "key \"spacing\" is missing in [cloud]: moving least squares need the node spacing H");
  if (options.spacing == 0.0 && result.mesh_ratio > 0.0)
    cloud.fail("spacing", "key \"spacing\" is missing in [cloud]: geometry.mesh_ratio is relative to it");
  options.seed = static_cast<std::uint64_t>(
      cloud.integer("seed", 0, std::numeric_limits<std::int64_t>::max(), static_cast<std::int64_t>(options.seed)));
  options.support = cloud.number("support", {1.0, 10.0, true, true}, options.support);
  options.weight = cloud.choice<Weight>("weight",
                                        {{"heat_geodesic", Weight::heat_geodesic},
                                         {"heat_flow", Weight::heat_flow},
                                         {"fast_marching", Weight::fast_marching},
                                         {"visibility", Weight::visibility},
                                         {"euclidean", Weight::euclidean}},
                                        options.weight);
  options.kernel = cloud.choice<Kernel>("kernel",
                                        {{"cubic_spline", Kernel::cubic_spline},
                                         {"quintic_spline", Kernel::quintic_spline},
                                         {"wendland_c2", Kernel::wendland_c2}},
                                        options.kernel);

  options.secondary = quadrature.choice<SecondaryKind>(
      "basis", {{"mls", SecondaryKind::mls}, {"cells", SecondaryKind::cells}, {"full", SecondaryKind::full}},
      options.secondary);
  options.ratio = quadrature.number("ratio", {0.25, 100.0, true, true}, options.ratio);
  result.model.stabilisation = quadrature.number("stabilisation", {0.0, 1.0, true, true}, 0.0);
  options.fine = result.model.stabilisation > 0.0;
}

/// The [[boundary]] entries: each prescribes one thing on one group. Loads are refused where the body is held against
/// them.
class BoundaryReader {
 public:
  BoundaryReader(const Expressions<2>& expressions, Case& result) : expressions_(expressions), result_(result) {}

  void read(const std::vector<Section>& entries) {
    for (const Section& entry : entries) {
      result_.groups.push_back({entry.text("on"), entry.where("on")});
      read_support(entry, entry.text("on"), only_kind(entry));
    }
    for (const Section& entry : entries) read_load(entry, entry.text("on"), only_kind(entry));
  }

 private:
  void read_support(const Section& entry, const std::string& on, std::string_view kind) {
    if (kind == "displacement") {
      refuse_if_held(entry, kind, on, normal);
      const auto components = entry.expressions<2>(kind);
      if (components[0] == "free" && components[1] == "free")
        entry.fail(kind, "displacement leaves every component free, expected a value for one of them");
      DisplacementCondition<2> condition{on, {}, {}};
      for (std::size_t i = 0; i < 2; ++i) {
        if (components[i] == "free") continue;
        claim(entry, kind, on, component[i]);
        condition.components[i] = expressions_.field(components[i], entry.where(kind));
      }
      result_.supports.push_back(std::move(condition));
    } else if (kind == "normal_displacement") {
      for (const char* what : component) refuse_if_held(entry, kind, on, what);
      claim(entry, kind, on, normal);
      result_.supports.push_back({on, {}, expressions_.field(entry.expression(kind), entry.where(kind))});
    }
  }
  void read_load(const Section& entry, const std::string& on, std::string_view kind) {
    if (kind == "traction") {
      const auto components = entry.expressions<2>(kind);
      for (std::size_t i = 0; i < 2; ++i)
        if (components[i] != "0" && components[i] != "-0") refuse_if_held(entry, kind, on, component[i]);
      const auto traction = expressions_.fields(components, entry.where(kind));
      result_.loads.tractions.push_back({on, [traction](const Vec<2>& x, const Vec<2>&) { return traction(x); }});
    } else if (kind == "pressure") {
      refuse_if_held(entry, kind, on, normal);
      if (claimed_.contains({on, component[0]})) refuse_if_held(entry, kind, on, component[1]);
      result_.loads.tractions.push_back(pressure<2>(on, expressions_.field(entry.expression(kind), entry.where(kind))));
    }
  }
  static std::string_view only_kind(const Section& entry) {
    std::vector<std::string_view> found;
    for (const std::string_view kind : {"displacement", "normal_displacement", "traction", "pressure"})
      if (entry.has(kind)) found.push_back(kind);
    if (found.size() != 1)
      entry.fail(
          "on",
          fmt::format(
              "a [[boundary]] entry prescribes exactly one of displacement, normal_displacement, traction, pressure; "
              "this one has {}. Several entries may name the same boundary",
              found.empty() ? "none" : fmt::format("{}", fmt::join(found, " and "))));
    return found.front();
  }
  void claim(const Section& entry, std::string_view key, const std::string& on, const std::string& what) {
    const auto [earlier, is_new] = claimed_.try_emplace({on, what}, entry.where(key));
    if (!is_new) entry.fail(key, fmt::format("{} on \"{}\" is already prescribed at {}", what, on, earlier->second));
  }
  void refuse_if_held(const Section& entry, std::string_view key, const std::string& on,
                      const std::string& what) const {
    if (const auto held = claimed_.find({on, what}); held != claimed_.end())
      entry.fail(key, fmt::format("{} on \"{}\" contradicts the {} prescribed at {}, expected one of them", key, on,
                                  what, held->second));
  }

  static constexpr std::array<const char*, 2> component{"displacement component x", "displacement component y"};
  static constexpr const char* normal = "normal displacement";

  const Expressions<2>& expressions_;
  Case& result_;
  std::map<std::pair<std::string, std::string>, std::string> claimed_;  ///< where, by boundary and what is prescribed
};

void read_exact(const Section& section, const Expressions<2>& expressions, Case& result) {
  if (section.has("displacement"))
    result.exact.displacement =
        expressions.fields(section.expressions<2>("displacement"), section.where("displacement"));
  if (section.has("stress"))
    result.exact.stress = expressions.fields(section.expressions<3>("stress"), section.where("stress"));
  if (!result.has_exact()) section.fail("", "[exact] is empty, expected displacement or stress");
}

void read_probes(const std::vector<Section>& sections, Case& result) {
  std::set<std::string> names;
  for (const Section& section : sections) {
    result.probes.push_back({section.text("name"), section.point("at"), section.where("at")});
    const std::string& name = result.probes.back().name;
    if (!names.insert(name).second) section.fail("name", fmt::format("there already is a probe named \"{}\"", name));
  }
}

}  // namespace

bool locks_without_dilatation(const Case& analysis) {
  return analysis.approximation.kind == BasisKind::mls && analysis.model.plane == Plane::strain &&
         analysis.model.material.nu > 0.4;
}

void impose(Case& analysis, Essential essential) {
  analysis.model.essential = essential;
  auto& vanish_on = analysis.approximation.vanish_on;
  vanish_on.clear();
  if (essential == Essential::nitsche || analysis.approximation.kind != BasisKind::mls) return;
  for (const auto& support : analysis.supports)
    if (std::ranges::find(vanish_on, support.on) == vanish_on.end()) vanish_on.push_back(support.on);
}

Case read_case(const std::filesystem::path& file) {
  const toml::table table = parse(file);
  const Section root(table, "", file.string(),
                     {"title", "definitions", "geometry", "cloud", "quadrature", "basis", "analysis", "material",
                      "boundary", "exact", "probe"});
  const Section geometry =
      root.required_section("geometry", {"file", "mesh_size", "mesh_ratio", "slits", "parameters"});
  const Section cloud = root.section("cloud", {"spacing", "seed", "support", "weight", "kernel"});
  const Section quadrature = root.section("quadrature", {"basis", "ratio", "stabilisation", "dilatation"});
  const Section basis = root.section("basis", {"kind", "order"});
  const Section analysis = root.required_section("analysis", {"plane", "essential", "body_force"});
  const Section material = root.required_section("material", {"model", "E", "nu"});
  const auto boundaries =
      root.sections("boundary", {"on", "displacement", "normal_displacement", "traction", "pressure"});
  const auto probes = root.sections("probe", {"name", "at"});

  Case result;
  result.file = file;
  result.title = root.text("title", file.stem().string());
  const Expressions<2> expressions = read_definitions(root);
  read_geometry(geometry, result);
  read_approximation(cloud, quadrature, basis, result);

  result.model.plane = analysis.choice<Plane>("plane", {{"stress", Plane::stress}, {"strain", Plane::strain}}, {});
  if (analysis.has("body_force"))
    result.loads.body_force = expressions.fields(analysis.expressions<2>("body_force"), analysis.where("body_force"));
  material.choice<int>("model", {{"linear_elastic", 0}}, 0);
  result.model.material = {material.number("E", positive), material.number("nu", {-1.0, 0.5})};
  result.approximation.dilatation = quadrature.switch_or_auto("dilatation").value_or(locks_without_dilatation(result));

  if (boundaries.empty())
    throw InputError(fmt::format("{}: no [[boundary]] entry: nothing holds or loads the body", file.string()));
  BoundaryReader(expressions, result).read(boundaries);
  const bool nodal = result.approximation.kind != BasisKind::mls;
  impose(result,
         analysis.choice<Essential>("essential", {{"nitsche", Essential::nitsche}, {"strong", Essential::strong}},
                                    nodal ? Essential::strong : Essential::nitsche));

  if (root.has("exact")) read_exact(root.section("exact", {"displacement", "stress"}), expressions, result);
  read_probes(probes, result);
  return result;
}

}  // namespace efree
