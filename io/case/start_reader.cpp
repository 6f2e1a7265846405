// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/io/case/internal/start_reader.hpp"

#include "efree/io/case/case_file.hpp"

#include <fmt/format.h>
#include <algorithm>
#include <vector>

namespace efree {

std::filesystem::path find_dynamics_state(const std::filesystem::path& directory) {
  std::error_code unknown;
  for (const std::filesystem::path& folder : {directory, directory / "unfinished"})
    if (std::filesystem::path file = folder / dynamics_state_name; std::filesystem::is_regular_file(file, unknown))
      return file;
  return {};
}

namespace internal {
namespace {

/// Whether nodes do not stay with the material, so that only a factor scales masses.
template <int Dim> bool takes_factor_alone(const DynamicsSettings<Dim>& dynamics) {
  return (dynamics.method == DynamicsMethod::mpm && dynamics.mpm.frame != MpmFrame::total) ||
         (dynamics.method == DynamicsMethod::sph && dynamics.sph.frame == SphFrame::updated);
}

template <int Dim>
void read_state(const Section& section, const std::filesystem::path& folder, DynamicsSettings<Dim>& dynamics) {
  StateStart start{.directory = (folder / section.text("state")).string(), .where = section.where("state")};
  std::error_code unknown;
  if (!std::filesystem::is_directory(start.directory, unknown))
    section.fail("state", fmt::format("there is no directory {}: expected that of the results of an earlier run",
                                      start.directory));
  if (find_dynamics_state(start.directory).empty())
    section.fail("state", fmt::format("there is no {} in {}: expected the results of a run of explicit dynamics",
                                      dynamics_state_name, start.directory));
  const bool at_rest = section.boolean("static", false);
  start.velocities = section.boolean("velocities", !at_rest);
  if (start.velocities && at_rest)
    section.fail("velocities",
                 "bodies that come to rest lose the velocities of the state: leave out velocities, or "
                 "static");
  if (start.velocities && !dynamics.initial_velocities.empty())
    throw InputError(
        fmt::format("{}: bodies begin with the velocities of the state in {}: leave out [[velocity]], or "
                    "take velocities = false in [start]",
                    dynamics.initial_velocities.front().where, start.directory));
  dynamics.state_start = std::move(start);
}

/// Components as text by their keys; those that are not given are 0.
template <int Dim>
void read_stresses(const Section& section, const Expressions<Dim>& expressions, DynamicsSettings<Dim>& dynamics) {
  const bool axisymmetric = Dim == 2 && dynamics.common.model.plane == Plane::axisymmetric;
  Section::Keys keys{"region", "xx", "yy", "zz", "xy"};
  if (Dim == 3) keys.insert(keys.end(), {"yz", "xz"});
  for (const Section& entry : section.sections("stress", keys)) {
    InitialStress<Dim> initial{.region = entry.text("region", ""), .where = entry.where()};
    for (const InitialStress<Dim>& earlier : dynamics.initial_stresses)
      if (earlier.region == initial.region)
        entry.fail("region", fmt::format("{} stresses already, from {}",
                                         initial.region.empty() ? "all bodies without their own have"
                                                                : fmt::format("the region \"{}\" has", initial.region),
                                         earlier.where));
    for (const char* normal : {"xx", "yy", "zz"})
      if (!entry.has(normal))
        entry.fail("", fmt::format("key \"{}\" is missing: expected the normal components xx, yy and zz{}", normal,
                                   axisymmetric ? " (around the axis)"
                                   : Dim == 2   ? " (out of the plane)"
                                                : ""));
    std::array<std::string, 6> texts;  // xx, yy, zz, yz, xz, xy
    constexpr const char* names[] = {"xx", "yy", "zz", "yz", "xz", "xy"};
    for (std::size_t k = 0; k < 6; ++k) texts[k] = entry.has(names[k]) ? entry.expression(names[k]) : "0";
    initial.stress = [field = expressions.template fields<6>(texts, initial.where)](const Vec<Dim>& x) {
      const Vec<6> s = field(x);
      Mat<3> result;
      result << s[0], s[5], s[4], s[5], s[1], s[3], s[4], s[3], s[2];
      return result;
    };
    dynamics.initial_stresses.push_back(std::move(initial));
  }
}

}  // namespace

template <int Dim> void read_times(const Section& time, const Section& output, DynamicsSettings<Dim>& dynamics) {
  dynamics.end = time.number("end", positive);
  dynamics.max_step = time.number("max_step", positive, dynamics.max_step);
  dynamics.min_step = time.number("min_step", {0.0, dynamics.max_step, false, true}, dynamics.min_step);
  dynamics.frames = static_cast<Index>(output.integer("frames", 0, 100000, dynamics.frames));
  dynamics.history_lines = static_cast<Index>(output.integer("history", 0, 10000000, dynamics.history_lines));
  dynamics.checkpoint_interval = output.number("checkpoint", positive, dynamics.checkpoint_interval);
}

template <int Dim> void read_mass_scaling(const Section& time, DynamicsSettings<Dim>& dynamics) {
  if (!time.has("mass_scaling")) return;
  const Section section = time.section("mass_scaling", {"factor", "step"});
  if (!section.has("factor") && !section.has("step"))
    section.fail("", "mass_scaling: expected a factor, a step, or both, such as { factor = 100 }");
  MassScaling& scaling = dynamics.options.mass_scaling;
  scaling.factor = section.number("factor", {1.0, Interval::infinity, true, false}, scaling.factor);
  scaling.step = section.number("step", {0.0, dynamics.end, false, true}, scaling.step);
  if (scaling.step > 0.0 && takes_factor_alone(dynamics))
    section.fail("step",
                 "mass_scaling to a step needs nodes that stay with the material, which this method has not: take a "
                 "factor, or frame = \"total\"");
}

template <int Dim> void read_start(const Section& root, const std::filesystem::path& folder,
                                   const Expressions<Dim>& expressions, DynamicsSettings<Dim>& dynamics) {
  if (!root.has("start")) return;
  const Section section = root.section("start", {"static", "residual", "spin", "state", "velocities", "stress"});
  const bool is_else = section.has("state") || section.has("stress");
  if (section.has("state") && section.has("stress"))
    section.fail("stress", "bodies begin with the stresses of the state: leave out stress, or state");
  if (section.has("state"))
    read_state(section, folder, dynamics);
  else if (section.has("velocities"))
    section.fail("velocities", "velocities means nothing without a state");
  if (section.has("stress")) read_stresses(section, expressions, dynamics);
  if (!section.boolean("static", !is_else)) {
    for (const char* key : {"residual", "spin"})
      if (section.has(key)) section.fail(key, fmt::format("{} means nothing without a static start", key));
    return;
  }
  StaticStart<Dim> start{.where = section.where()};
  start.residual = section.number("residual", {0.0, 0.1, false, true}, start.residual);
  if (section.has("spin")) {
    if (dynamics.common.model.plane == Plane::axisymmetric && Dim == 2)
      section.fail("spin", "an axisymmetric section does not turn in its plane: take all of the body in space");
    if (dynamics.options.mass_scaling.on())
      section.fail(
          "spin", "bodies that rotate have the centrifugal forces of all their mass: leave out mass_scaling in [time]");
    if constexpr (Dim == 2)
      start.spin[0] = section.number("spin", any_number);
    else
      start.spin = section.template point<3>("spin");
  }
  dynamics.static_start = start;
}

#define EFREE_INSTANTIATE(Dim)                                                                    \
  template void read_times(const Section&, const Section&, DynamicsSettings<Dim>&);               \
  template void read_mass_scaling(const Section&, DynamicsSettings<Dim>&);                        \
  template void read_start(const Section&, const std::filesystem::path&, const Expressions<Dim>&, \
                           DynamicsSettings<Dim>&);
EFREE_INSTANTIATE(2)
EFREE_INSTANTIATE(3)
#undef EFREE_INSTANTIATE

}  // namespace internal
}  // namespace efree
