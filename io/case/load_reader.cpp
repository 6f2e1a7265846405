// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/io/case/internal/load_reader.hpp"

#include "efree/io/case/internal/function_of_time.hpp"
#include "efree/materials/piecewise_linear.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <algorithm>
#include <memory>
#include <optional>
#include <utility>

namespace efree::internal {
namespace {

/// What a [[boundary]] may have, one of them in each entry.
constexpr std::array boundary_kinds{"velocity", "displacement", "traction", "pressure",
                                    "force",    "stiffness",    "damping"};
constexpr std::array axes{"x", "y", "z"};

template <int Dim> using Law = std::function<double(const Vec<Dim>& start, double time)>;
template <int Dim> using VectorLaw = std::function<Vec<Dim>(const Vec<Dim>& start, double time)>;

/// Factors by time; none: 1.
struct Ramp {
  std::optional<PiecewiseLinear> factors{};
  double at(double time) const { return factors ? factors->at(time).value : 1.0; }
};

Ramp read_ramp(const Section& entry) {
  if (!entry.has("ramp")) return {};
  const auto points = entry.pairs("ramp");
  const auto later = [](const auto& one, const auto& next) { return !(next[0] > one[0]); };
  if (points.empty() || std::ranges::adjacent_find(points, later) != points.end())
    entry.fail("ramp", "ramp: expected pairs of a time and a factor, in the order of the times");
  return {entry.tabulated("ramp", [](std::vector<double> times, std::vector<double> factors) {
    return PiecewiseLinear(std::move(times), std::move(factors), "time", "factor");
  })};
}

template <int Dim> class LoadReader {
 public:
  LoadReader(const Section& root, const ScalarField<Dim>& grey, PlaceReader<Dim>& places,
             DynamicsSettings<Dim>& dynamics)
      : root_(root),
        grey_(grey),
        clock_(std::make_shared<double>(0.0)),
        expressions_(read_definitions<Dim>(root, grey, {.time = {}, .clock = clock_})),
        places_(places),
        dynamics_(dynamics) {}

  void read_gravity(const Section& analysis) {
    if (analysis.has("body_force"))
      analysis.fail("body_force", "body_force is for static analyses: take gravity, a force per mass");
    if (analysis.has("rotation"))
      analysis.fail("rotation",
                    "rotation is for static analyses: give bodies a velocity by which they rotate, in [[velocity]]");
    if (!analysis.has("gravity")) return;
    const auto texts = analysis.expressions<Dim>("gravity");
    const std::string where = analysis.where("gravity");
    if (depends_on_position(texts, where)) {
      dynamics_.gravity_field = vector_law(texts, where, {});
      return;
    }
    dynamics_.gravity = read_function_of_time<Dim, Dim>(texts, analysis, "gravity", root_, grey_);
    dynamics_.gravity_depends_on_time = depends_on_time(texts, where);
  }

  void read_boundary(const Section& entry) {
    const std::string kind = kind_of(entry), on = places_.name(entry), where = entry.where(kind);
    const Ramp ramp = read_ramp(entry);
    if (entry.has("ramp") && (kind == "stiffness" || kind == "damping"))
      entry.fail("ramp", fmt::format("ramp means nothing for {}, which does not change with time", kind));
    if (entry.has("follower") && kind != "pressure")
      entry.fail("follower", "follower is for a pressure, and there is none");
    if (kind == "velocity" || kind == "displacement") return read_motion(entry, kind, on, ramp);
    BoundaryLoad<Dim> added{.on = on, .load = {}, .where = where};
    if (kind == "traction") added.load.traction = vector_law(entry.template expressions<Dim>(kind), where, ramp);
    if (kind == "pressure") {
      added.load.pressure = law(entry.expression(kind), where, ramp);
      added.load.follows = entry.boolean("follower", true);
    }
    if (kind == "force") {
      const auto force =
          read_function_of_time<Dim, Dim>(entry.template expressions<Dim>(kind), entry, kind, root_, grey_);
      added.force = [force, ramp](double t) { return Vec<Dim>(ramp.at(t) * force(t)); };
    }
    if (kind == "stiffness") added.load.stiffness = read_coefficients(entry, kind);
    if (kind == "damping") added.load.damping = read_coefficients(entry, kind);
    dynamics_.boundary_loads.push_back(std::move(added));
  }

 private:
  static std::string kind_of(const Section& entry) {
    std::vector<std::string> found;
    for (const char* kind : boundary_kinds)
      if (entry.has(kind)) found.emplace_back(kind);
    if (found.size() != 1)
      entry.fail("on",
                 fmt::format("a [[boundary]] entry has exactly one of {}; this one has {}. Several entries may name "
                             "the same boundary",
                             fmt::join(boundary_kinds, ", "),
                             found.empty() ? "none" : fmt::format("{}", fmt::join(found, " and "))));
    return found.front();
  }
  template <std::size_t Size>
  bool depends_on_time(const std::array<std::string, Size>& texts, const std::string& where) const {
    return std::ranges::any_of(texts, [&](const std::string& text) { return expressions_.uses("t", text, where); });
  }
  template <std::size_t Size>
  bool depends_on_position(const std::array<std::string, Size>& texts, const std::string& where) const {
    const Expressions<Dim> now = read_definitions<Dim>(root_, grey_, {0.0});
    return std::ranges::any_of(texts, [&](const std::string& text) { return now.varies(text, where); });
  }
  Law<Dim> law(const std::string& text, const std::string& where, const Ramp& ramp) const {
    return [clock = clock_, field = expressions_.field(text, where), ramp](const Vec<Dim>& start, double t) {
      *clock = t;
      return ramp.at(t) * field(start);
    };
  }
  VectorLaw<Dim> vector_law(const std::array<std::string, Dim>& texts, const std::string& where,
                            const Ramp& ramp) const {
    return [clock = clock_, fields = expressions_.fields(texts, where), ramp](const Vec<Dim>& start, double t) {
      *clock = t;
      return Vec<Dim>(ramp.at(t) * fields(start));
    };
  }
  /// One number for all directions, or one for each.
  static Vec<Dim> read_coefficients(const Section& entry, const std::string& key) {
    if (!entry.table().get(key)->is_array()) return Vec<Dim>::Constant(entry.number(key, positive));
    const Vec<Dim> result = entry.template point<Dim>(key);
    if (!(result.minCoeff() >= 0.0) || result.isZero(0.0))
      entry.fail(
          key, fmt::format("{} is ({}), expected numbers >= 0 and one that is not zero", key, fmt::join(result, ", ")));
    return result;
  }

  /// Prescribed velocities or displacements.
  void read_motion(const Section& entry, const std::string& kind, const std::string& on, const Ramp& ramp) {
    BoundaryVelocity<Dim> part{
        .on = on, .velocity = {}, .is_displacement = kind == "displacement", .where = entry.where(kind)};
    const auto components = entry.template expressions<Dim>(kind);
    if (std::ranges::count(components, "free") == Dim)
      entry.fail(kind, fmt::format("{} leaves every component free, expected a value for one of them", kind));
    for (std::size_t i = 0; i < Dim; ++i) {
      if (components[i] == "free") continue;
      for (const auto& earlier : dynamics_.boundary_velocities)
        if (earlier.on == part.on && earlier.velocity[i])
          entry.fail(kind, fmt::format("the velocity along {} on \"{}\" is prescribed already", axes[i], part.on));
      part.velocity[i] = law(components[i], part.where, ramp);
      part.depends_on_time |=
          part.is_displacement || entry.has("ramp") || expressions_.uses("t", components[i], part.where);
    }
    dynamics_.boundary_velocities.push_back(std::move(part));
  }

  const Section& root_;
  const ScalarField<Dim>& grey_;
  std::shared_ptr<double> clock_;
  Expressions<Dim> expressions_;
  PlaceReader<Dim>& places_;
  DynamicsSettings<Dim>& dynamics_;
};

}  // namespace

Section::Keys dynamics_boundary_keys() {
  Section::Keys keys{"on", "ramp", "follower"};
  keys.insert(keys.end(), boundary_kinds.begin(), boundary_kinds.end());
  return keys;
}

template <int Dim> void read_loads(const Section& analysis, const std::vector<Section>& boundaries, const Section& root,
                                   const ScalarField<Dim>& grey, PlaceReader<Dim>& places,
                                   DynamicsSettings<Dim>& dynamics) {
  LoadReader<Dim> reader(root, grey, places, dynamics);
  reader.read_gravity(analysis);
  for (const Section& entry : boundaries) reader.read_boundary(entry);
}

template void read_loads(const Section&, const std::vector<Section>&, const Section&, const ScalarField<2>&,
                         PlaceReader<2>&, DynamicsSettings<2>&);
template void read_loads(const Section&, const std::vector<Section>&, const Section&, const ScalarField<3>&,
                         PlaceReader<3>&, DynamicsSettings<3>&);

}  // namespace efree::internal
