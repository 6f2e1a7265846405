// SPDX-License-Identifier: GPL-3.0-or-later
/// Explicit dynamics.
#include "efree/core/error.hpp"
#include "efree/io/case/internal/case_parts.hpp"
#include "efree/io/case/internal/case_readers.hpp"
#include "efree/io/case/internal/fracture_reader.hpp"
#include "efree/io/case/internal/load_reader.hpp"
#include "efree/io/case/internal/material_reader.hpp"
#include "efree/io/case/internal/picture_reader.hpp"
#include "efree/io/case/internal/rigid_reader.hpp"
#include "efree/io/case/internal/start_reader.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <algorithm>
#include <cmath>
#include <set>

namespace efree::internal {
namespace {

template <int Dim> void read_velocities(const std::vector<Section>& entries, const Expressions<Dim>& expressions,
                                        DynamicsSettings<Dim>& dynamics) {
  for (const Section& entry : entries) {
    InitialVelocity<Dim> initial{.region = entry.text("region", ""), .velocity = {}, .where = entry.where("value")};
    for (const auto& earlier : dynamics.initial_velocities)
      if (earlier.region == initial.region || earlier.region.empty() || initial.region.empty())
        entry.fail("region", fmt::format("{} a velocity already, from {}",
                                         earlier.region.empty() ? "all bodies have"
                                                                : fmt::format("the region \"{}\" has", earlier.region),
                                         earlier.where));
    initial.velocity = expressions.fields(entry.expressions<Dim>("value"), initial.where);
    dynamics.initial_velocities.push_back(std::move(initial));
  }
}

/// A column of history.csv: "rigid_body.0.force.y".
template <int Dim> void read_mean_force(const Section& entry, std::size_t num_rigid_bodies, DynamicsProbe<Dim>& probe) {
  for (const char* of_others : {"box", "region", "share"})
    if (entry.has(of_others)) entry.fail(of_others, fmt::format("{} means nothing for a mean force", of_others));
  probe.kind = DynamicsProbe<Dim>::Kind::mean_force;
  const std::string text = entry.text("mean_force");
  for (probe.rigid_body = 0; probe.rigid_body < num_rigid_bodies; ++probe.rigid_body)
    for (probe.component = 0; probe.component < Dim; ++probe.component)
      if (text == fmt::format("rigid_body.{}.force.{}", probe.rigid_body, "xyz"[probe.component])) return;
  entry.fail(
      "mean_force",
      num_rigid_bodies == 0
          ? "there is no [[rigid_body]] for a mean force"
          : fmt::format("mean_force is \"{}\", expected \"rigid_body.0.force.x\" or likewise for another axis{}", text,
                        num_rigid_bodies == 1 ? "" : fmt::format(" and body, 0 to {}", num_rigid_bodies - 1)));
}

template <int Dim> DynamicsProbe<Dim> read_probe(const Section& entry, const Section& definitions,
                                                 const Expressions<Dim>& expressions, std::size_t num_rigid_bodies) {
  using Kind = typename DynamicsProbe<Dim>::Kind;
  Section::Keys found;
  for (const std::string_view key : {"largest", "smallest", "extent", "at", "mean_force"})
    if (entry.has(key)) found.push_back(key);
  if (found.size() != 1)
    entry.fail("name",
               fmt::format("a probe has exactly one of largest, smallest, extent, at, mean_force; this one has {}",
                           found.empty() ? "none" : fmt::format("{}", fmt::join(found, " and "))));
  const std::string key(found.front());
  DynamicsProbe<Dim> probe{.name = entry.text("name"), .region = entry.text("region", ""), .where = entry.where(key)};
  if (key == "at") {
    if (entry.has("box")) entry.fail("box", "box means nothing for a single node");
    for (const char* of_numbers : {"truth", "share"})
      if (entry.has(of_numbers))
        entry.fail(of_numbers, fmt::format("{} is of a single number, not of the motion of a node", of_numbers));
    probe.kind = Kind::node;
    probe.at = entry.template point<Dim>("at");
    return probe;
  }
  if (entry.has("truth")) probe.truth = entry.number("truth", any_number);
  if (key == "mean_force") {
    read_mean_force(entry, num_rigid_bodies, probe);
    return probe;
  }
  probe.kind = key == "largest" ? Kind::largest : key == "smallest" ? Kind::smallest : Kind::extent;
  // A name that is neither a coordinate nor one of [definitions] is a field.
  const std::string text = entry.expression(key);
  const bool is_name =
      text.find_first_not_of("abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789_") == std::string::npos &&
      text != "x" && text != "y" && text != "z";
  if (is_name && std::isalpha(static_cast<unsigned char>(text.front())) && !definitions.has(text))
    probe.field = text;
  else
    probe.coordinate = expressions.field(text, entry.where(key));
  if (entry.has("box")) {
    const auto [a, b] = entry.template corners<Dim>("box");
    probe.box = BoundingBox<Dim>(a.cwiseMin(b), a.cwiseMax(b));
  }
  probe.share = entry.number("share", {0.0, 1.0, false, true}, 1.0);
  return probe;
}

template <int Dim> void read_probes(const std::vector<Section>& entries, const Section& definitions,
                                    const Expressions<Dim>& expressions, DynamicsSettings<Dim>& dynamics) {
  std::set<std::string> names;
  for (const Section& entry : entries) {
    dynamics.probes.push_back(read_probe<Dim>(entry, definitions, expressions, dynamics.rigid_bodies.size()));
    const std::string& name = dynamics.probes.back().name;
    if (!names.insert(name).second) entry.fail("name", fmt::format("there already is a probe named \"{}\"", name));
  }
}

/// [dynamics].
template <int Dim> void read_dynamics(const Section& root, DynamicsSettings<Dim>& dynamics) {
  const Section section = root.section("dynamics", {"method", "courant", "imbalance", "damping", "shock"});
  const bool has_cloud = root.has("cloud");
  dynamics.method = section.choice<DynamicsMethod>("method",
                                                   {{"otm", DynamicsMethod::otm},
                                                    {"total_lagrangian", DynamicsMethod::total_lagrangian},
                                                    {"mpm", DynamicsMethod::mpm},
                                                    {"sph", DynamicsMethod::sph}},
                                                   has_cloud         ? DynamicsMethod::total_lagrangian
                                                   : root.has("mpm") ? DynamicsMethod::mpm
                                                   : root.has("sph") ? DynamicsMethod::sph
                                                                     : DynamicsMethod::otm);
  if (dynamics.method == DynamicsMethod::mpm && has_cloud)
    section.fail("method",
                 "method \"mpm\" has its nodes on a grid, and there is a [cloud]: leave out [cloud], or take method = "
                 "\"total_lagrangian\"");
  if (dynamics.method == DynamicsMethod::sph && has_cloud)
    section.fail("method",
                 "method \"sph\" has its particles on a lattice, and there is a [cloud]: leave out [cloud], or take "
                 "method = \"total_lagrangian\"");
  if (dynamics.method == DynamicsMethod::otm && has_cloud)
    section.fail("method",
                 "method \"otm\" has its nodes at the vertices of the mesh, and there is a [cloud]: leave out [cloud], "
                 "or take method = \"total_lagrangian\"");
  if (dynamics.method == DynamicsMethod::total_lagrangian && !has_cloud)
    section.fail(
        "method",
        "method \"total_lagrangian\" has the shape functions of a [cloud], and there is none: add [cloud] with "
        "a spacing, or take method = \"otm\"");
  DynamicsOptions& options = dynamics.options;
  options.courant = section.number("courant", {0.0, 1.0, false, true}, options.courant);
  options.imbalance = section.number("imbalance", {0.0, 1.0, false, true}, options.imbalance);
  options.damping = section.number("damping", not_negative, options.damping);
  if (section.has("shock")) {
    const Section shock = section.section("shock", {"linear", "quadratic"});
    options.shock.linear = shock.number("linear", not_negative, options.shock.linear);
    options.shock.quadratic = shock.number("quadratic", not_negative, options.shock.quadratic);
  }
}

/// [otm].
template <int Dim> void read_otm(const Section& root, DynamicsSettings<Dim>& dynamics) {
  const Section section =
      root.section("otm", {"gamma", "cutoff", "reconnection_strain", "exact_integration", "anisotropy", "merging",
                           "insertion", "momentum", "stabilisation", "pressure_diffusion", "seizing"});
  if (root.has("otm") && dynamics.method != DynamicsMethod::otm)
    root.fail("otm", dynamics.method != DynamicsMethod::total_lagrangian
                         ? "[otm] has options of the method \"otm\", and this case has another one: leave out [otm]"
                         : "[otm] has options of the method \"otm\", and this case with a [cloud] has the method "
                           "\"total_lagrangian\": leave out [otm], or [cloud]");
  OtmOptions& options = dynamics.otm;
  options.lme.gamma = section.number("gamma", {0.1, 20.0, true, true}, options.lme.gamma);
  options.lme.cutoff = section.number("cutoff", {1e-16, 0.1, true, true}, options.lme.cutoff);
  options.reconnection_strain =
      section.number("reconnection_strain", {0.0, 0.5, true, true}, options.reconnection_strain);
  options.exact_integration = section.boolean("exact_integration", options.exact_integration);
  options.anisotropy = section.number("anisotropy", {1.0, 100.0, true, true}, options.anisotropy);
  options.merging = section.number("merging", {0.0, 0.9, true, true}, options.merging);
  options.insertion = section.number("insertion", {0.0, 10.0, true, true}, options.insertion);
  if (options.insertion > 0.0 && options.insertion < 1.3)
    section.fail("insertion", fmt::format("insertion is {}, expected 0, or 1.3 to 10", options.insertion));
  options.momentum = section.choice<MomentumTransfer>(
      "momentum",
      {{"affine", MomentumTransfer::affine}, {"nodes", MomentumTransfer::nodes}, {"points", MomentumTransfer::points}},
      options.momentum);
  options.stabilisation = section.number("stabilisation", {0.0, 100.0, true, true}, options.stabilisation);
  options.pressure_diffusion =
      section.number("pressure_diffusion", {0.0, 10.0, true, true}, options.pressure_diffusion);
  options.seizing = section.boolean("seizing", options.seizing);
}

/// Whether the case uses a method, whose options are in the section `name`. Throws InputError if the case has this
/// section but uses another method, and for axisymmetric cases, which the method does not support; `who`: the method in
/// messages.
template <int Dim> bool has_method(const Section& root, const DynamicsSettings<Dim>& dynamics, DynamicsMethod method,
                                   const char* name, const char* who) {
  if (dynamics.method != method) {
    if (root.has(name))
      root.fail(name, fmt::format("[{0}] has options of the method \"{0}\", and this case has another one: leave out "
                                  "[{0}], or take dynamics.method = \"{0}\"",
                                  name));
    return false;
  }
  if (dynamics.common.model.plane == Plane::axisymmetric)
    root.fail(name, fmt::format("{} of plane strain or in space, not of an axisymmetric section: take dynamics.method "
                                "= \"otm\", or all of the body in space",
                                who));
  return true;
}

/// [mpm]; after the material and the geometry.
template <int Dim> void read_mpm(const Section& root, DynamicsSettings<Dim>& dynamics) {
  const Section section =
      root.section("mpm", {"cell", "points", "degree", "transfer", "flip", "order", "remap", "frame"});
  if (!has_method(root, dynamics, DynamicsMethod::mpm, "mpm", "the material point method is")) return;
  if (!section.has("cell"))
    section.fail(
        "",
        "key \"cell\" is missing in [mpm]: the edge of the grid's cells; about an eighth of the thickness of a "
        "body resolves its bending");
  MpmSettings& mpm = dynamics.mpm;
  MpmOptions& options = mpm.options;
  options.cell = section.number("cell", positive);
  mpm.points_along = static_cast<Index>(section.integer("points", 1, 8, mpm.points_along));
  options.degree = static_cast<int>(section.integer("degree", 1, 3, options.degree));
  mpm.frame = section.choice<MpmFrame>(
      "frame", {{"updated", MpmFrame::updated}, {"total", MpmFrame::total}, {"mesh", MpmFrame::mesh}}, mpm.frame);
  if (mpm.frame == MpmFrame::mesh && section.has("points"))
    section.fail("points",
                 "points means nothing with frame = \"mesh\", whose cells are those of the mesh: take mesh_size in "
                 "[geometry], about half of mpm.cell");
  if (mpm.frame == MpmFrame::mesh && section.has("remap"))
    section.fail("remap", "remap means nothing with frame = \"mesh\", whose strains are those between vertices");
  for (const char* key : {"transfer", "flip", "order", "remap"})
    if (mpm.frame == MpmFrame::total && section.has(key))
      section.fail(key, fmt::format("{} means nothing with frame = \"total\", whose nodes keep their velocities", key));
  options.transfer = section.choice<Transfer>("transfer",
                                              {{"pic", Transfer::pic},
                                               {"flip", Transfer::flip},
                                               {"apic", Transfer::apic},
                                               {"rpic", Transfer::rpic},
                                               {"aflip", Transfer::aflip},
                                               {"polypic", Transfer::polypic},
                                               {"xpic", Transfer::xpic}},
                                              options.transfer);
  if (section.has("flip") && options.transfer != Transfer::flip && options.transfer != Transfer::aflip)
    section.fail("flip", "flip is for transfer = \"flip\" or \"aflip\"");
  if (section.has("order") && options.transfer != Transfer::xpic)
    section.fail("order", "order is for transfer = \"xpic\"");
  options.flip = section.number("flip", {0.0, 1.0, true, true}, options.flip);
  options.order = static_cast<int>(section.integer("order", 1, 16, options.order));
  options.remap = section.boolean("remap", options.remap);
}

/// [sph]; after the material and the geometry.
template <int Dim> void read_sph(const Section& root, DynamicsSettings<Dim>& dynamics) {
  const Section section = root.section(
      "sph", {"spacing", "smoothing", "kernel", "frame", "corrected", "viscosity", "artificial_stress", "splitting"});
  if (!has_method(root, dynamics, DynamicsMethod::sph, "sph", "smoothed particles are")) return;
  if (!section.has("spacing"))
    section.fail("",
                 "key \"spacing\" is missing in [sph]: the distance of the particles; about a twentieth of the height "
                 "of a heap resolves how it fails");
  SphSettings& sph = dynamics.sph;
  SphOptions& options = sph.options;
  options.spacing = section.number("spacing", positive);
  options.smoothing = section.number("smoothing", {0.8, 3.0, true, true}, options.smoothing);
  options.kernel = section.choice<SmoothingKernel>(
      "kernel", {{"cubic_spline", SmoothingKernel::cubic_spline}, {"wendland_c2", SmoothingKernel::wendland_c2}},
      options.kernel);
  sph.frame =
      section.choice<SphFrame>("frame", {{"updated", SphFrame::updated}, {"total", SphFrame::total}}, sph.frame);
  options.corrected = section.boolean("corrected", options.corrected);
  for (const char* key : {"corrected", "viscosity", "artificial_stress", "splitting"})
    if (sph.frame == SphFrame::total && section.has(key))
      section.fail(key, fmt::format("{} is for pairs of particles that move past each other, and means nothing with "
                                    "frame = \"total\"",
                                    key));
  if (section.has("viscosity")) {
    const Section viscosity = section.section("viscosity", {"linear", "quadratic"});
    options.viscosity.linear = viscosity.number("linear", not_negative, options.viscosity.linear);
    options.viscosity.quadratic = viscosity.number("quadratic", not_negative, options.viscosity.quadratic);
  }
  if (section.has("artificial_stress")) {
    const Section stress = section.section("artificial_stress", {"strength", "compression", "exponent"});
    options.artificial_stress.strength = stress.number("strength", {0.0, 1.0, true, true}, 0.5);
    options.artificial_stress.compression =
        stress.number("compression", {0.0, 1.0, true, true}, options.artificial_stress.compression);
    options.artificial_stress.exponent = stress.number("exponent", not_negative, 0.0);
  }
  if (section.has("splitting")) {
    const Section splitting = section.section("splitting", {"strain", "separation", "smoothing", "levels"});
    options.splitting.strain = splitting.number("strain", positive);
    options.splitting.separation = splitting.number("separation", {0.2, 0.8, true, true}, options.splitting.separation);
    options.splitting.smoothing = splitting.number("smoothing", {0.4, 0.9, true, true}, options.splitting.smoothing);
    options.splitting.levels = static_cast<int>(splitting.integer("levels", 1, 3, options.splitting.levels));
  }
}

/// [contact]; after [otm].
template <int Dim> void read_contact(const Section& root, DynamicsSettings<Dim>& dynamics) {
  const Section section = root.section("contact", {"enabled", "self", "tie", "friction", "close"});
  ContactOptions& contact = dynamics.options.contact;
  for (const char* key : {"enabled", "self", "tie", "friction", "close"})
    if (dynamics.otm.seizing && section.has(key))
      section.fail(key, fmt::format("{} means nothing for bodies that seize (otm.seizing): leave it out", key));
    else if (dynamics.method == DynamicsMethod::sph && dynamics.sph.frame == SphFrame::updated && section.has(key))
      section.fail(key, fmt::format("{} means nothing for smoothed particles, which act on those of other bodies as on "
                                    "those of their own: leave it out, or take another method",
                                    key));
  contact.enabled = section.boolean("enabled", !dynamics.otm.seizing);
  contact.self = section.boolean("self", contact.self);
  dynamics.tied = section.boolean("tie", dynamics.tied);
  contact.friction = section.number("friction", not_negative, contact.friction);
  if (!section.has("close")) return;
  dynamics.closed_gap = section.number("close", positive);
  if (!contact.enabled) section.fail("close", "close is for bodies in contact: leave out that, or enabled = false");
}

/// [relaxation]; after [time].
template <int Dim> void read_relaxation(const Section& root, DynamicsSettings<Dim>& dynamics) {
  if (!root.has("relaxation")) return;
  const Section section = root.section("relaxation", {"residual", "from"});
  dynamics.residual = section.number("residual", {0.0, 0.1, false, true}, 1e-3);
  dynamics.options.rest_from = section.number("from", {0.0, dynamics.end, true, false}, 0.0);
}

/// [cloud] and [quadrature].
template <int Dim> void read_cloud(const Section& root, PlaceReader<Dim>& places, DynamicsCase<Dim>& result) {
  const Section cloud = root.section("cloud", cloud_keys());
  const Section quadrature = root.section("quadrature", {"basis", "ratio", "dilatation"});
  if (root.has("cloud") && !cloud.has("spacing"))
    cloud.fail("",
               "key \"spacing\" is missing in [cloud]: add it, or leave out [cloud] for nodes at the vertices of the "
               "mesh");
  if (!root.has("cloud"))
    for (const char* key : {"basis", "ratio"})
      if (quadrature.has(key))
        quadrature.fail(
            key, fmt::format("{} is for a [cloud], and there is none: every cell of the mesh has one point", key));
  read_approximation<Dim>(cloud, quadrature, result.geometry.ratio, result.common);
  result.common.approximation.grading = read_grading(cloud, places, result.common.graded);
  result.pressure_patches = quadrature.switch_or_auto("dilatation");
}

/// [[gas]].
template <int Dim>
void read_gases(const std::vector<Section>& entries, PlaceReader<Dim>& places, DynamicsSettings<Dim>& dynamics) {
  for (const Section& entry : entries)
    dynamics.gases.push_back({.on = places.name(entry),
                              .pressure = entry.number("pressure", any_number),
                              .exponent = entry.number("exponent", positive, GasFilling{}.exponent),
                              .where = entry.where("on")});
}

/// Of all but [time] and [output], with mass_scaling of [time] all the same, and of the files that the case names.
std::uint64_t fingerprint(const toml::table& table, const std::filesystem::path& folder, const Section& geometry,
                          const std::vector<Section>& rigid_bodies, const std::filesystem::path& state) {
  toml::table rest = table;
  rest.erase("time");
  rest.erase("output");
  if (const auto scaling = table["time"]["mass_scaling"]) rest.insert("mass_scaling", *scaling.node());
  Fingerprint mark;
  mark.add(text_of(toml::node_view<const toml::node>(rest)));
  if (geometry.has("file")) add_file(mark, folder / geometry.text("file"));
  for (const Section& body : rigid_bodies)
    if (body.has("file")) add_file(mark, folder / body.text("file"));
  if (!state.empty()) add_file(mark, find_dynamics_state(state));
  return mark.value();
}

}  // namespace

Section::Keys dynamics_keys() {
  return {"title",    "definitions", "geometry",   "cloud",    "quadrature", "analysis", "material", "velocity",
          "fracture", "wall",        "rigid_body", "boundary", "gas",        "contact",  "probe",    "time",
          "dynamics", "relaxation",  "start",      "otm",      "mpm",        "sph",      "output"};
}

template <int Dim> DynamicsCase<Dim> read_dynamics(const CaseText& text) {
  const Section& root = text.root;
  const Section analysis = root.required_section("analysis", {"kind", "plane", "gravity", "body_force", "rotation"});
  const Section time = root.required_section("time", {"end", "max_step", "min_step", "mass_scaling"});
  const Section output = root.section("output", {"frames", "history", "checkpoint", "pictures", "animation"});
  const auto velocities = root.sections("velocity", {"region", "value"});
  const auto fractures =
      root.sections("fracture", {"region", "toughness", "neighbourhood", "stretch", "strain", "spall"});
  const auto walls = root.sections("wall", {"normal", "level", "friction"});
  const auto rigid_bodies = root.sections(
      "rigid_body", {"shape", "normal", "level", "centre", "radius", "axis", "points", "file", "height", "origin",
                     "spacing", "friction", "velocity", "spin", "mass", "inertia", "free", "force"});
  const auto boundaries = root.sections("boundary", dynamics_boundary_keys());
  const auto gases = root.sections("gas", {"on", "pressure", "exponent"});
  const auto probes = root.sections(
      "probe", {"name", "largest", "smallest", "extent", "at", "mean_force", "box", "region", "truth", "share"});

  DynamicsCase<Dim> result;
  read_common(text, analysis, {{"strain", Plane::strain}, {"axisymmetric", Plane::axisymmetric}}, result.common,
              result.geometry);
  const Expressions<Dim> expressions = read_definitions<Dim>(
      root, result.geometry.grey,
      {std::nullopt,
       "only gravity, what is prescribed on boundaries, and velocities of rigid bodies may depend on the time t"});
  MaterialReader<Dim>(expressions, "explicit dynamics asks").read(root, result.common);
  PlaceReader<Dim> places(result.common);
  read_velocities<Dim>(velocities, expressions, result);
  result.fractures = read_fractures(fractures);
  read_walls<Dim>(walls, result);
  read_rigid_bodies<Dim>(rigid_bodies, text.folder(), root, result.geometry.grey, result);
  read_times(time, output, result);
  result.pictures = read_pictures(output, {.solid = Dim == 3});
  result.animation = output.choice<std::string>("animation", {{"webm", "webm"}, {"mp4", "mp4"}, {"gif", "gif"}}, "");
  read_loads<Dim>(analysis, boundaries, root, result.geometry.grey, places, result);
  read_cloud(root, places, result);
  read_dynamics(root, result);
  read_otm(root, result);
  read_mpm(root, result);
  read_sph(root, result);
  read_contact(root, result);
  read_relaxation(root, result);
  read_mass_scaling(time, result);
  read_start<Dim>(root, text.folder(), expressions, result);
  read_gases(gases, places, result);
  read_probes<Dim>(probes, root.section("definitions", {}), expressions, result);
  result.mark = {fingerprint(*text.table, text.folder(), text.geometry, rigid_bodies,
                             result.state_start ? result.state_start->directory : ""),
                 0};
  return result;
}

void reject_former_keys(const Section& root) {
  if (root.has("tool")) root.fail("tool", "[[tool]] has a new name: write [[rigid_body]]");
  if (!root.is_table("analysis")) return;
  const Section analysis = root.section("analysis", {});
  const auto kind = analysis.has("kind") ? analysis.table().get("kind")->value_or(std::string()) : std::string();
  if (kind == "otm")
    analysis.fail("kind",
                  "kind \"otm\" has a new name: write kind = \"dynamics\". [dynamics] has the method, \"otm\" or, with "
                  "a [cloud], \"total_lagrangian\"");
  if (kind != "dynamics") return;
  struct FormerKey {
    const char *section, *key, *place;
  };
  constexpr FormerKey former_keys[] = {
      {"analysis", "acceleration", "gravity in [analysis]"},
      {"otm", "renewal", "reconnection_strain in [otm]"},
      {"otm", "injection", "insertion in [otm]"},
      {"otm", "courant", "courant in [dynamics]"},
      {"otm", "imbalance", "imbalance in [dynamics]"},
      {"otm", "shock", "shock in [dynamics]"},
      {"contact", "seizing", "seizing in [otm]"},
      {"contact", "stiffness", "enabled = false in [contact] for bodies that pass through each other, else nothing"},
      {"output", "colour", "pictures = [{ field = \"von_mises\" }] in [output]"},
  };
  for (const auto& [section, key, place] : former_keys)
    if (root.is_table(section))
      if (const Section given = root.section(section, {}); given.has(key))
        given.fail(key, fmt::format("{} in [{}] is no longer known: write {}", key, section, place));
}

template DynamicsCase<2> read_dynamics<2>(const CaseText&);
template DynamicsCase<3> read_dynamics<3>(const CaseText&);

}  // namespace efree::internal
