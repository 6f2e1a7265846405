// SPDX-License-Identifier: GPL-3.0-or-later
/// Static analyses.
#include "efree/analysis/point_field.hpp"
#include "efree/core/error.hpp"
#include "efree/io/case/expression.hpp"
#include "efree/io/case/internal/boundary_reader.hpp"
#include "efree/io/case/internal/case_parts.hpp"
#include "efree/io/case/internal/case_readers.hpp"
#include "efree/io/case/internal/material_reader.hpp"
#include "efree/io/case/internal/picture_reader.hpp"
#include "efree/io/case/internal/section.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <algorithm>
#include <array>
#include <memory>
#include <regex>
#include <set>
#include <tuple>
#include <utility>

namespace efree::internal {
namespace {

template <int Dim> void read_load_cases(const std::vector<Section>& sections, const Section::Keys& keys,
                                        BoundaryReader<Dim>& boundaries, Case<Dim>& result) {
  std::set<std::string> names;
  for (const Section& section : sections) {
    LoadCase<Dim>& one = result.cases.emplace_back(section.text("name"));
    if (!names.insert(one.name).second)
      section.fail("name", fmt::format("there already is a case named \"{}\"", one.name));
    boundaries.read_case(section.sections("boundary", keys), one.loads);
  }
}

template <int Dim> void read_exact(const Section& section, const Expressions<Dim>& expressions, Case<Dim>& result) {
  if (section.has("displacement"))
    result.exact.displacement =
        expressions.fields(section.expressions<Dim>("displacement"), section.where("displacement"));
  if (section.has("stress")) {
    if (Dim == 3 || result.common.model.plane == Plane::axisymmetric) {
      result.exact.stress = expressions.fields(section.expressions<voigt_size<Dim>>("stress"), section.where("stress"));
    } else if constexpr (Dim == 2) {  // the stress out of the plane does no work
      const auto in_plane = expressions.fields(section.expressions<3>("stress"), section.where("stress"));
      result.exact.stress = [in_plane](const Vec<2>& x) {
        const Vec<3> stress = in_plane(x);
        return Voigt<2>(stress[0], stress[1], 0.0, stress[2]);
      };
    }
  }
  if (!result.has_exact()) section.fail("", "[exact] is empty, expected displacement or stress");
}

template <int Dim> void read_probes(const std::vector<Section>& sections, Case<Dim>& result) {
  std::set<std::string> names;
  for (const Section& section : sections) {
    result.probes.push_back({section.text("name"), section.point<Dim>("at"), section.where("at")});
    const std::string& name = result.probes.back().name;
    if (!names.insert(name).second) section.fail("name", fmt::format("there already is a probe named \"{}\"", name));
  }
}

template <int Dim>
void read_reactions(const std::vector<Section>& sections, PlaceReader<Dim>& places, Case<Dim>& result) {
  for (const Section& section : sections) {
    const std::string name = section.text("name"), on = places.name(section);
    if (std::ranges::find(result.reactions, name, &Reaction::name) != result.reactions.end())
      section.fail("name", fmt::format("there already is a reaction named \"{}\"", name));
    if (std::ranges::find(result.supports, on, &DisplacementCondition<Dim>::on) == result.supports.end())
      section.fail("on", fmt::format("no displacement is prescribed on \"{}\": it has no reaction", on));
    result.reactions.push_back({name, on, section.where("on")});
  }
}

/// Forces per mass: an acceleration, and a rotation about an axis.
template <int Dim>
void read_mass_forces(const Section& analysis, const Expressions<Dim>& expressions, Settings<Dim>& result) {
  if (analysis.has("acceleration"))
    result.loads.mass_forces.push_back(
        {expressions.fields(analysis.expressions<Dim>("acceleration"), analysis.where("acceleration")),
         "acceleration"});
  if (!analysis.has("rotation")) return;
  const Section turning = analysis.required_section("rotation", {"speed", "axis", "through"});
  const bool axisymmetric = Dim == 2 && result.common.model.plane == Plane::axisymmetric;
  if (Dim == 2 && turning.has("axis"))
    turning.fail("axis", axisymmetric ? "an axisymmetric body turns about its own axis, y: leave axis out"
                                      : "a planar body turns about the axis out of its plane: leave axis out");
  if (axisymmetric && turning.has("through"))
    turning.fail("through", "an axisymmetric body turns about its own axis, y: leave through out");
  Vec<3> axis = axisymmetric ? Vec<3>::UnitY() : Vec<3>::UnitZ();
  if (Dim == 3) axis = turning.direction<3>("axis");
  const Vec<Dim> through = turning.has("through") ? turning.point<Dim>("through") : Vec<Dim>(Vec<Dim>::Zero());
  result.loads.mass_forces.push_back(rotation<Dim>(turning.number("speed", any_number), axis, through));
}

/// The largest of what is to be reported.
template <int Dim> void read_extremes(const Section& analysis, Settings<Dim>& result) {
  if (!analysis.has("extremes")) return;
  for (const std::string& what : analysis.texts("extremes")) {
    if (what == "displacement")
      result.largest_displacement = true;
    else if (what == "von_mises")
      result.largest_stress = true;
    else
      analysis.fail("extremes", fmt::format("extremes has \"{}\", expected \"displacement\" or \"von_mises\"", what));
  }
}

/// An error in the energy norm, and those of probes and reactions by name.
template <int Dim> void read_accuracy(const Section& accuracy, Case<Dim>& result) {
  const Interval range{1e-6, 1.0, true, false};
  const auto read = [&](const char* key, Goal::Of of, const auto& named) {
    if (!accuracy.has(key)) return;
    std::vector<std::string_view> names;
    for (const auto& one : named) names.push_back(one.name);
    if (names.empty()) accuracy.fail(key, fmt::format("the case has no {}", key));
    const Section errors = accuracy.section(key, names);
    for (const auto& entry : errors.table()) {
      const std::string name(entry.first.str());
      result.goals.push_back({of, name, errors.number(name, range)});
    }
  };
  read("probes", Goal::Of::probe, result.probes);
  read("reactions", Goal::Of::reaction, result.reactions);
  if (result.goals.empty() || accuracy.has("energy")) result.accuracy = accuracy.number("energy", range);
  result.time_limit = accuracy.number("time_limit", positive, result.time_limit);
  require_estimates(result);
}

/// "auto", "off" or a number of iterations.
template <int Dim> void read_correction(const Section& analysis, Settings<Dim>& result) {
  result.largest_error = analysis.number("largest_error", positive, result.largest_error);
  if (!analysis.has("correction")) return;
  if (result.common.approximation.kind != BasisKind::mls)
    analysis.fail("correction", "correction means nothing for finite elements: there is no cloud to correct");
  if (!analysis.table().get("correction")->is_string()) {
    result.correction.iterations = static_cast<int>(analysis.integer("correction", 1, 1000));
    return;
  }
  result.corrected = analysis.choice<bool>("correction", {{"auto", true}, {"off", false}}, std::nullopt);
}

/// [basis].
template <int Dim> void read_basis(const Section& basis, Settings<Dim>& result) {
  ApproximationOptions& options = result.common.approximation;
  using Kind = std::pair<BasisKind, OnCells>;
  std::tie(options.kind, result.cells) = basis.choice<Kind>("kind",
                                                            {{"auto", {BasisKind::mls, OnCells::automatic}},
                                                             {"mls", {BasisKind::mls, OnCells::never}},
                                                             {"p1", {BasisKind::p1, OnCells::never}},
                                                             {"p2", {BasisKind::p2, OnCells::never}},
                                                             {"cells", {BasisKind::mls, OnCells::always}}},
                                                            Kind{BasisKind::mls, OnCells::automatic});
  options.order = static_cast<int>(basis.integer("order", 1, 2, options.order));
  options.interpolation = static_cast<int>(basis.integer("interpolation", 1, 2, options.interpolation));
}

/// Cells have no cloud: what the file says of one decides against them, or contradicts it. In the plane the same
/// decides for a cloud where elements would do without.
template <int Dim>
void read_cells(const Section& root, const Section& basis, const Section& analysis, Settings<Dim>& result) {
  if (result.cells == OnCells::never) return;
  if (Dim == 2 && result.cells == OnCells::always)
    basis.fail("kind", "cells are for images in space; this geometry is planar");
  std::vector<std::string> said;
  for (const char* key : {"cloud", "quadrature"})
    if (root.has(key)) said.push_back(fmt::format("[{}]", key));
  for (const char* key : {"order", "interpolation"})
    if (basis.has(key)) said.push_back(fmt::format("basis.{}", key));
  for (const char* key : {"correction", "essential"})
    if (analysis.has(key)) said.push_back(fmt::format("analysis.{}", key));
  if (said.empty()) return;
  if (result.cells == OnCells::always)
    basis.fail("kind", fmt::format("{} means nothing on cells, which have no cloud", fmt::join(said, ", ")));
  result.cells = OnCells::never;
}

constexpr std::array boundary_keys{"on",
                                   "displacement",
                                   "normal_displacement",
                                   "stiffness",
                                   "normal_stiffness",
                                   "traction",
                                   "pressure",
                                   "follower",
                                   "force",
                                   "moment",
                                   "at"};
constexpr std::array analysis_keys{"kind",       "plane",         "essential",      "body_force",
                                   "correction", "largest_error", "extremes",       "acceleration",
                                   "rotation",   "model",         "model_tolerance"};

/// What holds and loads the body, into the case, which knows its plane.
template <int Dim> void read_acting(const Section& root, const Expressions<Dim>& expressions, PlaceReader<Dim>& places,
                                    Case<Dim>& result) {
  const Section::Keys keys(boundary_keys.begin(), boundary_keys.end());
  const Section analysis = root.section("analysis", {analysis_keys.begin(), analysis_keys.end()});
  if (analysis.has("body_force"))
    result.loads.body_force = expressions.fields(analysis.expressions<Dim>("body_force"), analysis.where("body_force"));
  read_mass_forces(analysis, expressions, result);
  BoundaryReader<Dim> conditions(expressions, places, result);
  conditions.read(root.sections("boundary", keys));
  read_load_cases(root.sections("case", {"name", "boundary"}), keys, conditions, result);
}

/// The time, and definitions that depend on it.
class TimeNames {
 public:
  explicit TimeNames(const Section& root) {
    const Section definitions = root.section("definitions", {});
    for (std::size_t before = 0; before != names_.size();) {
      before = names_.size();
      for (const auto& [key, node] : definitions.table())
        if (in(node)) names_.insert(std::string(key.str()));
    }
  }
  /// Whether an expression below a node has one of them in it.
  bool in(const toml::node& node) const {
    static const std::regex name("[A-Za-z_][A-Za-z0-9_]*");
    if (const auto* text = node.as_string()) {
      const std::string& all = text->get();
      return std::any_of(std::sregex_iterator(all.begin(), all.end(), name), std::sregex_iterator(),
                         [&](const std::smatch& found) { return names_.contains(found.str()); });
    }
    const auto below = [&](const toml::node& one) { return in(one); };
    if (const auto* array = node.as_array()) return std::ranges::any_of(*array, below);
    if (const auto* table = node.as_table())
      return std::ranges::any_of(*table, [&](const auto& entry) {
        return entry.first.str() != "on" && entry.first.str() != "name" && in(entry.second);
      });
    return false;
  }
  /// Throws InputError if a value of a table (or of an array of them), but for these keys, does.
  void refuse_in(const Section& root, std::string_view key, const std::vector<std::string_view>& but,
                 const std::string& why) const {
    const auto refuse = [&](const toml::table& table) {
      for (const auto& [name, node] : table)
        if (std::ranges::find(but, name.str()) == but.end() && in(node))
          throw InputError(fmt::format("{}: {} depends on t: {}", root.where(node), name.str(), why));
    };
    const toml::node* there = root.table().get(key);
    if (!there) return;
    if (const auto* table = there->as_table()) refuse(*table);
    if (const auto* array = there->as_array())
      for (const toml::node& one : *array)
        if (const auto* table = one.as_table()) refuse(*table);
  }

 private:
  std::set<std::string> names_{"t"};
};

/// Of which steps the fields are written.
int read_output(const Section& time) {
  if (!time.has("output")) return 0;
  if (time.table().get("output")->is_integer()) return static_cast<int>(time.integer("output", 1, 1000000000));
  return time.choice<int>("output", {{"last", 0}, {"all", 1}}, std::nullopt);
}

/// [time] until: a probe or a reaction of the case, and bounds.
template <int Dim> PathEnd read_until(const Section& time, const Case<Dim>& of) {
  const Section until = time.section("until", {"probe", "reaction", "component", "above", "below"});
  if (until.has("probe") == until.has("reaction"))
    until.fail("", "until has exactly one of probe, reaction: what is looked at, by its name");
  if (!until.has("above") && !until.has("below"))
    until.fail("", "until has no bound: expected above or below, a number that ends the path once it is passed");
  const char* key = until.has("probe") ? "probe" : "reaction";
  PathEnd end{until.has("probe") ? PathEnd::Of::probe : PathEnd::Of::reaction, until.text(key)};
  std::vector<std::string_view> names;
  if (end.of == PathEnd::Of::probe) {
    for (const auto& probe : of.probes) names.push_back(probe.name);
  } else {
    for (const auto& reaction : of.reactions) names.push_back(reaction.name);
    for (const auto& support : of.supports) names.push_back(support.on);
  }
  if (names.empty()) until.fail(key, fmt::format("the case has no {}", key));
  if (std::ranges::find(names, end.name) == names.end())
    until.fail(key, fmt::format("there is no {} \"{}\"; {}", key, end.name, suggestion(end.name, names)));
  std::vector<std::pair<std::string_view, int>> components{{"length", -1}, {"x", 0}, {"y", 1}};
  if (Dim == 3) components.emplace_back("z", 2);
  end.component = until.choice<int>("component", components, -1);
  if (until.has("above")) end.above = until.number("above", any_number);
  if (until.has("below")) end.below = until.number("below", any_number);
  return end;
}

/// [time]: the steps, and what acts at each time if something depends on it.
template <int Dim>
TimeSettings<Dim> read_time(const Section& root, const std::shared_ptr<const toml::table>& table, const Case<Dim>& of) {
  const Section section =
      root.section("time", {"end", "step", "min_step", "max_step", "max_steps", "control", "stops", "until", "output"});
  TimeSettings<Dim> result;
  result.path.end = section.number("end", positive, 1.0);
  const Interval up_to_end{0.0, result.path.end, false, true};
  if (section.has("step")) result.path.step = section.number("step", up_to_end);
  if (section.has("max_step") && !section.has("step"))
    result.path.step = std::min(result.path.first_step(), section.number("max_step", positive));
  const double first = result.path.first_step();
  if (section.has("min_step")) result.path.min_step = section.number("min_step", {0.0, first, false, true});
  if (section.has("max_step")) result.path.max_step = section.number("max_step", {first, Interval::infinity, true});
  result.path.control =
      section.choice<Control>("control", {{"load", Control::load}, {"arc_length", Control::arc_length}}, Control::load);
  result.path.max_steps = static_cast<int>(section.integer("max_steps", 1, 10000000, result.path.max_steps));
  if (section.has("stops") && result.path.control == Control::arc_length)
    section.fail("stops", "by arc length steps end where the path leads, not at stops");
  if (section.has("stops")) result.path.stops = section.numbers("stops", {0.0, result.path.end, false, true});
  const Section analysis = root.section("analysis", {analysis_keys.begin(), analysis_keys.end()});
  if (analysis.has("extremes"))
    analysis.fail("extremes", "extremes means nothing with a [time]: errors of single values are not estimated");
  if (analysis.has("correction") && analysis.table().get("correction")->is_number())
    analysis.fail("correction", "with a [time] corrections are not counted: expected \"auto\" or \"off\"");
  const TimeNames names(root);
  names.refuse_in(root, "material", {"model", "region", "fit", "strain"}, "materials do not change with time");
  for (const Section& entry : root.sections("boundary", {boundary_keys.begin(), boundary_keys.end()}))
    for (const char* key : {"stiffness", "normal_stiffness"})
      if (entry.has(key) && names.in(*entry.table().get(key)))
        entry.fail(key, fmt::format("{} depends on t, and springs do not change with time", key));
  const auto mentioned = [&](const char* key) { return table->contains(key) && names.in(*table->get(key)); };
  if (!mentioned("boundary") && !mentioned("analysis")) return result;
  result.acting = [table, file = of.common.where, plane = of.common.model.plane,
                   expressions = read_definitions<Dim>(root, of.geometry.grey, {0.0})](double time) {
    const Section all(*table, "", file, {});
    Case<Dim> then;
    then.common.where = file;
    then.common.model.plane = plane;
    PlaceReader<Dim> places(then.common);
    read_acting(all, expressions.at_another_time(time), places, then);
    return Acting<Dim>{std::move(then.supports), std::move(then.loads)};
  };
  return result;
}

/// How much of the materials is modelled.
template <int Dim> void read_regime(const Section& analysis, Settings<Dim>& result) {
  if (analysis.has("model"))
    result.regime = analysis.choice<Regime>(
        "model", {{"auto", Regime::automatic}, {"linear", Regime::linear}, {"finite", Regime::finite}}, std::nullopt);
  result.regime_tolerance = analysis.number("model_tolerance", {0.0, 1.0, false, true}, result.regime_tolerance);
  if (analysis.has("model_tolerance") && result.regime && result.regime != Regime::automatic)
    analysis.fail("model_tolerance", "model_tolerance is for model = \"auto\", which it decides");
}

/// What steps through time may do otherwise when they are gone on with.
CaseMark mark_of(const toml::table& table, bool end_is_a_step, const std::filesystem::path& geometry) {
  Fingerprint what, how;
  toml::table rest = table;
  rest.erase("output");
  if (toml::table* time = rest["time"].as_table()) {
    const toml::table all = *time;
    for (const char* key : {"step", "min_step", "max_step", "max_steps", "stops", "control", "until"}) {
      how.add(key).add(text_of(all[key]));
      time->erase(key);
    }
    time->erase("output");
    if (end_is_a_step) time->erase("end");
  }
  what.add(text_of(toml::node_view<const toml::node>(rest)));
  add_file(what, geometry);
  return {what.value(), how.value()};
}

/// Fluids have no shape that they return to, so nothing is at rest under loads.
template <int Dim> void refuse_fluids(const Section& root, const Case<Dim>& result) {
  const auto refuse = [](const SharedMaterial& material, const std::string& where) {
    if (material && dynamic_cast<const Fluid*>(&*material) != nullptr)
      throw InputError(where + ": a fluid bears no load at rest: it is for explicit dynamics only");
  };
  if (root.is_table("material")) refuse(result.common.model.material, root.where("material"));
  for (const RegionMaterial& one : result.common.materials) refuse(one.material, one.where);
}

/// Fields of the body, of its materials' memories, and those that come with strengths and errors.
template <int Dim> PictureChoices picture_choices(const Case<Dim>& of) {
  const CommonSettings<Dim>& common = of.common;
  PictureChoices choices{
      .fields = PointField<Dim>::names(common.model.plane == Plane::axisymmetric), .solid = Dim == 3, .at_rest = true};
  const auto add = [&](const SharedMaterial& material, const Strength& strength) {
    std::vector<std::string> more;
    if (strength.is_given()) more.emplace_back("utilisation");
    if (material && of.time)
      for (const HistoryPart& part : material->history_parts())
        if (part.size == 1) more.push_back(part.name);
    for (const std::string& name : more)
      if (std::ranges::find(choices.fields, name) == choices.fields.end()) choices.fields.push_back(name);
  };
  add(common.model.material, common.strength);
  for (const RegionMaterial& one : common.materials) add(one.material, one.strength);
  if (!of.time) choices.fields.emplace_back("error");
  for (const LoadCase<Dim>& one : of.cases) choices.load_cases.push_back(one.name);
  return choices;
}

}  // namespace

Section::Keys static_keys() {
  return {"title",    "definitions", "geometry", "cloud", "quadrature", "basis",    "analysis", "material",
          "boundary", "case",        "exact",    "probe", "reaction",   "accuracy", "time",     "output"};
}

template <int Dim> Case<Dim> read_static(const CaseText& text) {
  const Section& root = text.root;
  const Section cloud = root.section("cloud", cloud_keys());
  const Section quadrature = root.section("quadrature", quadrature_keys());
  const Section basis = root.section("basis", {"kind", "order", "interpolation"});
  const Section::Keys of_analysis(analysis_keys.begin(), analysis_keys.end());
  const Section analysis =
      Dim == 2 ? root.required_section("analysis", of_analysis) : root.section("analysis", of_analysis);
  const auto probes = root.sections("probe", {"name", "at"});
  const auto reactions = root.sections("reaction", {"name", "on"});

  Case<Dim> result;
  read_common(text, analysis,
              {{"stress", Plane::stress}, {"strain", Plane::strain}, {"axisymmetric", Plane::axisymmetric}},
              result.common, result.geometry);
  if (root.has("time")) {
    result.time = read_time<Dim>(root, text.table, result);
    result.steps.fields_every = read_output(root.section("time", {}));
  }
  const ExpressionTime time{result.time ? std::optional(result.time->path.end) : std::nullopt,
                            "t is the time of [time], and the case has none"};
  const Expressions<Dim> expressions = read_definitions<Dim>(root, result.geometry.grey, time);
  read_approximation(cloud, quadrature, result.geometry.ratio, result.common);
  read_basis(basis, result);
  read_regime(analysis, result);
  const std::string asks_for_finite = result.regime == Regime::finite ? "analysis.model = \"finite\" asks" : "";
  MaterialReader<Dim>(expressions, asks_for_finite).read(root, result.common);
  refuse_fluids(root, result);

  if (root.sections("boundary", {boundary_keys.begin(), boundary_keys.end()}).empty())
    throw InputError(fmt::format("{}: no [[boundary]] entry: nothing holds or loads the body", result.common.where));
  PlaceReader<Dim> places(result.common);
  read_acting(root, expressions, places, result);
  read_reactions(reactions, places, result);
  result.common.approximation.grading = read_grading(cloud, places, result.common.graded);
  if (analysis.has("essential"))
    result.common.model.essential = analysis.choice<Essential>(
        "essential", {{"nitsche", Essential::nitsche}, {"strong", Essential::strong}}, std::nullopt);

  if (result.time && result.cells == OnCells::always)
    basis.fail("kind", "cells are for linear elasticity: with a [time] take a cloud");
  const Section output = root.section("output", {"mesh", "pictures"});
  result.with_mesh = output.boolean("mesh", false);
  result.pictures = read_pictures(output, picture_choices(result));
  read_correction(analysis, result);
  read_cells<Dim>(root, basis, analysis, result);
  read_extremes(analysis, result);
  if (root.has("exact")) read_exact(root.section("exact", {"displacement", "stress"}), expressions, result);
  read_probes(probes, result);
  if (result.time && root.section("time", {}).has("until"))
    result.time->until = read_until(root.section("time", {}), result);
  if (root.has("accuracy"))
    read_accuracy(root.section("accuracy", {"energy", "probes", "reactions", "time_limit"}), result);
  result.mark =
      mark_of(*text.table, result.time && result.time->acting,
              text.geometry.has("file") ? text.folder() / text.geometry.text("file") : std::filesystem::path());
  return result;
}

template Case<2> read_static<2>(const CaseText&);
template Case<3> read_static<3>(const CaseText&);

}  // namespace efree::internal
