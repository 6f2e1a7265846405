// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/io/case/otm_case.hpp"

#include "efree/core/error.hpp"
#include "efree/geometry/input/surface.hpp"
#include "efree/io/case/internal/case_parts.hpp"
#include "efree/io/case/internal/material_reader.hpp"
#include "efree/io/case/internal/read_geometry.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <algorithm>
#include <cmath>
#include <limits>
#include <set>

namespace efree {
namespace {

using internal::Section, internal::Interval, internal::any_number, internal::positive, internal::not_negative;

const Section::Keys otm_analysis_keys{"kind", "plane", "acceleration", "body_force", "rotation"};

/// Whether this is said to be a case of bodies in motion.
bool moves(const toml::table& table) {
  return table["analysis"]["kind"].value_or(std::string()) == "otm";
}

template <int Dim> void read_velocities(const std::vector<Section>& entries, const Expressions<Dim>& expressions,
                                        MotionSettings<Dim>& motion) {
  for (const Section& entry : entries) {
    InitialVelocity<Dim> thrown{.region = entry.text("region", ""), .velocity = {}, .where = entry.where("value")};
    for (const auto& earlier : motion.velocities)
      if (earlier.region == thrown.region || earlier.region.empty() || thrown.region.empty())
        entry.fail("region", fmt::format("{} a velocity already, from {}",
                                         earlier.region.empty() ? "all bodies have"
                                                                : fmt::format("the region \"{}\" has", earlier.region),
                                         earlier.where));
    thrown.velocity = expressions.fields(entry.expressions<Dim>("value"), thrown.where);
    motion.velocities.push_back(std::move(thrown));
  }
}

/// Force per mass, the same everywhere.
template <int Dim> Vec<Dim> read_acceleration(const Section& analysis, const Expressions<Dim>& expressions) {
  if (analysis.has("body_force"))
    analysis.fail("body_force",
                  "body_force is for bodies at rest: those in motion have a force per mass, acceleration");
  if (analysis.has("rotation"))
    analysis.fail("rotation", "rotation is for bodies at rest: those in motion turn by their velocity");
  if (!analysis.has("acceleration")) return Vec<Dim>::Zero();
  const auto texts = analysis.expressions<Dim>("acceleration");
  const std::string where = analysis.where("acceleration");
  for (const std::string& text : texts)
    if (expressions.varies(text, where))
      analysis.fail("acceleration",
                    fmt::format("acceleration of bodies in motion is \"{}\", expected the same everywhere", text));
  return expressions.fields(texts, where)(Vec<Dim>::Zero());
}

template <int Dim> void read_fractures(const std::vector<Section>& entries, MotionSettings<Dim>& motion) {
  for (const Section& entry : entries) {
    BodyFracture broken{.region = entry.text("region", ""), .where = entry.where("")};
    for (const auto& earlier : motion.fractures)
      if (earlier.region == broken.region || earlier.region.empty() || broken.region.empty())
        entry.fail("region", fmt::format("there is fracture already, from {}", earlier.where));
    OtmFracture& fracture = broken.fracture;
    fracture.toughness = entry.number("toughness", not_negative, fracture.toughness);
    fracture.neighbourhood = entry.number("neighbourhood", {0.0, 10.0, true, true}, fracture.neighbourhood);
    fracture.stretch = entry.number("stretch", {1.0, 1e3, false, true}, fracture.stretch);
    if (entry.has("strain")) {
      const Section law = entry.section("strain", {"D1", "D2", "D3", "D4", "D5", "rate", "melting"});
      JohnsonCookFailure failure;
      for (std::size_t i = 0; i < failure.D.size(); ++i)
        failure.D[i] = law.number(fmt::format("D{}", i + 1), any_number, 0.0);
      failure.reference = law.number("rate", positive, failure.reference);
      failure.melting = law.number("melting", not_negative, failure.melting);
      fracture.strain = failure;
    }
    if (!fracture.on()) entry.fail("", "[[fracture]]: expected toughness, stretch or strain");
    motion.fractures.push_back(std::move(broken));
  }
}

double read_friction(const Section& entry) {
  if (entry.has("friction") && entry.table().get("friction")->is_string())
    return entry.choice<double>("friction", {{"stick", std::numeric_limits<double>::infinity()}}, {});
  return entry.number("friction", not_negative, 0.0);
}

template <int Dim> void read_walls(const std::vector<Section>& entries, MotionSettings<Dim>& motion) {
  for (const Section& entry : entries) {
    OtmWall<Dim> wall{.normal = entry.template direction<Dim>("normal")};
    wall.level = entry.number("level", any_number, 0.0);
    wall.friction = read_friction(entry);
    motion.walls.push_back({wall, entry.where("normal")});
  }
}

/// Components that depend on the time alone.
template <int Dim, int Size>
std::function<Vec<Size>(double)> read_course(const std::array<std::string, static_cast<std::size_t>(Size)>& texts,
                                             const Section& entry, std::string_view key, const Section& root,
                                             const ScalarField<Dim>& grey) {
  const std::string where = entry.where(key);
  const Expressions<Dim> now = internal::read_definitions<Dim>(root, grey, {0.0});
  for (const std::string& text : texts)
    if (now.varies(text, where))
      entry.fail(key, fmt::format("{} of a tool is \"{}\", and may depend on the time t alone", key, text));
  const auto course = internal::read_definitions<Dim>(root, grey, {.time = {}, .runs = true})
                          .template fields<static_cast<std::size_t>(Size)>(texts, where);
  return [course](double t) { return Vec<Size>(course(t * Vec<Dim>::Unit(0))); };
}

template <int Dim>
ToolShape<Dim> read_shape(const Section& entry, const std::filesystem::path& folder, OtmTool<Dim>& tool) {
  const std::string name = entry.text("shape");
  const auto only = [&](const Section::Keys& its) {
    for (const char* key : {"normal", "level", "radius", "axis", "points", "file"})
      if (entry.has(key) && std::ranges::find(its, key) == its.end())
        entry.fail(key, fmt::format("{} means nothing for a tool of shape \"{}\"", key, name));
  };
  if (entry.has("centre")) tool.centre = entry.template point<Dim>("centre");
  if (name == "plane") {
    only({"normal", "level"});
    return tools::half_space<Dim>(entry.template direction<Dim>("normal"), entry.number("level", any_number, 0.0));
  }
  if (name == "ball") {
    only({"radius"});
    return tools::ball<Dim>(entry.template point<Dim>("centre"), entry.number("radius", positive));
  }
  if constexpr (Dim == 2) {
    if (name == "polygon") {
      only({"points"});
      const auto corners = entry.pairs("points");
      if (corners.size() < 3) entry.fail("points", "points: expected three corners and more");
      Points<2> at(2, static_cast<Index>(corners.size()));
      for (std::size_t k = 0; k < corners.size(); ++k) at.col(static_cast<Index>(k)) << corners[k][0], corners[k][1];
      return tools::solid<2>(at, tools::polygon(static_cast<Index>(corners.size())));
    }
  } else {
    if (name == "cylinder") {
      only({"radius", "axis"});
      return tools::cylinder(entry.template point<3>("centre"), entry.template direction<3>("axis"),
                             entry.number("radius", positive));
    }
    if (name == "surface") {
      only({"file"});
      const SurfaceSoup soup = read_surface((folder / entry.text("file")).string());
      Facets<3> facets(3, static_cast<Index>(soup.triangles.size()));
      for (std::size_t f = 0; f < soup.triangles.size(); ++f)
        for (int i = 0; i < 3; ++i) facets(i, static_cast<Index>(f)) = soup.triangles[f][static_cast<std::size_t>(i)];
      return tools::solid<3>(soup.points, facets);
    }
  }
  entry.fail("shape", fmt::format("shape is \"{}\", expected \"plane\", \"ball\", {}", name,
                                  Dim == 2 ? "\"polygon\"" : "\"cylinder\", \"surface\""));
}

template <int Dim> void read_tools(const std::vector<Section>& entries, const std::filesystem::path& folder,
                                   const Section& root, const ScalarField<Dim>& grey, MotionSettings<Dim>& motion) {
  constexpr int turns = Dim == 2 ? 1 : 3;
  for (const Section& entry : entries) {
    OtmTool<Dim> tool;
    try {
      tool.shape = read_shape<Dim>(entry, folder, tool);
    } catch (const InputError& error) {
      if (std::string(error.what()).starts_with("a ")) entry.fail("shape", error.what());
      throw;
    }
    tool.friction = read_friction(entry);
    if (entry.has("velocity"))
      tool.velocity = read_course<Dim, Dim>(entry.expressions<Dim>("velocity"), entry, "velocity", root, grey);
    if (entry.has("spin")) {
      std::array<std::string, turns> spin;
      if constexpr (Dim == 2)
        spin[0] = entry.expression("spin");
      else
        spin = entry.expressions<3>("spin");
      tool.spin = read_course<Dim, turns>(spin, entry, "spin", root, grey);
    }
    tool.mass = entry.number("mass", positive, 0.0);
    tool.inertia = entry.number("inertia", positive, 0.0);
    if ((tool.spin || tool.inertia > 0.0) && !entry.has("centre"))
      entry.fail("spin", "key \"centre\" is missing: about which the tool turns");
    motion.tools.push_back({tool, entry.where("shape")});
  }
}

template <int Dim> void read_moved(const std::vector<Section>& entries, const Expressions<Dim>& expressions,
                                   internal::PlaceReader<Dim>& places, MotionSettings<Dim>& motion) {
  constexpr const char* axes[] = {"x", "y", "z"};
  for (const Section& entry : entries) {
    MovedPart<Dim> part{.on = places.name(entry), .velocity = {}};
    const auto components = entry.expressions<Dim>("velocity");
    if (std::ranges::count(components, "free") == Dim)
      entry.fail("velocity", "velocity leaves every component free, expected a value for one of them");
    for (std::size_t i = 0; i < Dim; ++i) {
      if (components[i] == "free") continue;
      for (const auto& earlier : motion.moved)
        if (earlier.on == part.on && earlier.velocity[i])
          entry.fail("velocity",
                     fmt::format("the velocity along {} on \"{}\" is prescribed already", axes[i], part.on));
      part.velocity[i] = expressions.field(components[i], entry.where("velocity"));
    }
    motion.moved.push_back(std::move(part));
  }
}

template <int Dim>
MotionProbe<Dim> read_probe(const Section& entry, const Section& definitions, const Expressions<Dim>& expressions) {
  using Of = typename MotionProbe<Dim>::Of;
  Section::Keys found;
  for (const std::string_view key : {"largest", "smallest", "extent", "at"})
    if (entry.has(key)) found.push_back(key);
  if (found.size() != 1)
    entry.fail("name", fmt::format("a probe has exactly one of largest, smallest, extent, at; this one has {}",
                                   found.empty() ? "none" : fmt::format("{}", fmt::join(found, " and "))));
  const std::string kind(found.front());
  MotionProbe<Dim> probe{.name = entry.text("name"), .region = entry.text("region", ""), .where = entry.where(kind)};
  if (kind == "at") {
    if (entry.has("box")) entry.fail("box", "box means nothing for a single node");
    probe.of = Of::node;
    probe.at = entry.template point<Dim>("at");
    return probe;
  }
  probe.of = kind == "largest" ? Of::largest : kind == "smallest" ? Of::smallest : Of::extent;
  // A name that is no coordinate and none of [definitions] is a field's.
  const std::string what = entry.expression(kind);
  const bool is_name =
      what.find_first_not_of("abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789_") == std::string::npos &&
      what.size() > 1;
  if (is_name && std::isalpha(static_cast<unsigned char>(what.front())) && !definitions.has(what))
    probe.field = what;
  else
    probe.place = expressions.field(what, entry.where(kind));
  if (entry.has("box")) {
    const auto [a, b] = entry.template corners<Dim>("box");
    probe.box = BoundingBox<Dim>(a.cwiseMin(b), a.cwiseMax(b));
  }
  return probe;
}

template <int Dim> void read_probes(const std::vector<Section>& entries, const Section& definitions,
                                    const Expressions<Dim>& expressions, MotionSettings<Dim>& motion) {
  std::set<std::string> names;
  for (const Section& entry : entries) {
    motion.probes.push_back(read_probe<Dim>(entry, definitions, expressions));
    const std::string& name = motion.probes.back().name;
    if (!names.insert(name).second) entry.fail("name", fmt::format("there already is a probe named \"{}\"", name));
  }
}

void read_options(const Section& section, bool cloud, OtmOptions& options) {
  if (cloud)
    for (const char* key : {"gamma", "cutoff", "renewal", "exact_integration", "anisotropy", "merging", "injection",
                            "momentum", "stabilisation"})
      if (section.has(key))
        section.fail(key, fmt::format("{} is for functions that are made anew, and those of a [cloud] are not", key));
  options.lme.gamma = section.number("gamma", {0.1, 20.0, true, true}, options.lme.gamma);
  options.lme.cutoff = section.number("cutoff", {1e-16, 0.1, true, true}, options.lme.cutoff);
  options.renewal = section.number("renewal", {0.0, 0.5, true, true}, options.renewal);
  options.exact_integration = section.boolean("exact_integration", options.exact_integration);
  options.anisotropy = section.number("anisotropy", {1.0, 100.0, true, true}, options.anisotropy);
  options.merging = section.number("merging", {0.0, 0.9, true, true}, options.merging);
  options.injection = section.number("injection", {0.0, 10.0, true, true}, options.injection);
  if (options.injection > 0.0 && options.injection < 1.3)
    section.fail("injection", fmt::format("injection is {}, expected 0, or 1.3 to 10", options.injection));
  options.momentum = section.choice<OtmMomentum>(
      "momentum", {{"affine", OtmMomentum::affine}, {"nodes", OtmMomentum::nodes}, {"points", OtmMomentum::points}},
      options.momentum);
  options.courant = section.number("courant", {0.0, 1.0, false, true}, options.courant);
  if (section.has("shock")) {
    const Section shock = section.section("shock", {"linear", "quadratic"});
    options.shock.linear = shock.number("linear", not_negative, options.shock.linear);
    options.shock.quadratic = shock.number("quadratic", not_negative, options.shock.quadratic);
  }
  options.stabilisation = section.number("stabilisation", {0.0, 100.0, true, true}, options.stabilisation);
  options.imbalance = section.number("imbalance", {0.0, 1.0, false, true}, options.imbalance);
}

/// Functions: at the vertices of the mesh, or on a cloud.
template <int Dim> void read_functions(const Section& root, internal::PlaceReader<Dim>& places, OtmCase<Dim>& result) {
  const Section cloud = root.section("cloud", internal::cloud_keys());
  const Section quadrature = root.section("quadrature", {"basis", "ratio", "dilatation"});
  result.motion.cloud = cloud.has("spacing");
  if (root.has("cloud") && !cloud.has("spacing"))
    cloud.fail("",
               "key \"spacing\" is missing in [cloud]: without one, nodes are at the vertices of the mesh, and "
               "there is no cloud");
  if (!result.motion.cloud)
    for (const char* key : {"basis", "ratio"})
      if (quadrature.has(key))
        quadrature.fail(key,
                        fmt::format("{} is for a [cloud], and there is none: every cell of the mesh is a point", key));
  internal::read_approximation<Dim>(cloud, quadrature, root.section("basis", {}), result.geometry.ratio, result);
  result.approximation.grading = internal::read_grading(cloud, places, result.graded);
  result.motion.shared_dilatation = quadrature.switch_or_auto("dilatation");
}

template <int Dim> OtmCase<Dim> read(const std::filesystem::path& file, const toml::table& table, const Section& root,
                                     const Section& geometry, const Reading& reading) {
  const Section analysis = root.required_section("analysis", otm_analysis_keys);
  const Section time = root.required_section("time", {"end", "max_step", "min_step"});
  const Section output = root.section("output", {"frames", "history", "checkpoint", "colour"});
  const auto velocities = root.sections("velocity", {"region", "value"});
  const auto fractures = root.sections("fracture", {"region", "toughness", "neighbourhood", "stretch", "strain"});
  const auto walls = root.sections("wall", {"normal", "level", "friction"});
  const auto tools = root.sections("tool", {"shape", "normal", "level", "centre", "radius", "axis", "points", "file",
                                            "friction", "velocity", "spin", "mass", "inertia"});
  const auto boundaries = root.sections("boundary", {"on", "velocity"});
  const auto gases = root.sections("gas", {"on", "pressure", "exponent"});
  const auto probes = root.sections("probe", {"name", "largest", "smallest", "extent", "at", "box", "region"});

  OtmCase<Dim> result;
  MotionSettings<Dim>& motion = result.motion;
  result.where = file.string();
  result.said = internal::places_in(root);
  result.title = root.text("title", file.stem().string());
  result.keeps_free_bodies = true;
  result.geometry = internal::read_geometry<Dim>(geometry, file.parent_path(), reading);
  if (Dim == 3 && analysis.has("plane"))
    analysis.fail("plane", "plane means nothing here: the geometry is three-dimensional");
  result.model.plane =
      analysis.choice<Plane>("plane", {{"strain", Plane::strain}, {"axisymmetric", Plane::axisymmetric}},
                             Dim == 3 ? std::optional(Plane::strain) : std::nullopt);
  const Expressions<Dim> expressions = internal::read_definitions<Dim>(
      root, result.geometry.grey,
      {std::nullopt, "velocities are those at the start, or do not change, and neither do accelerations"});
  internal::MaterialReader<Dim>(expressions, "bodies in motion ask").read(root, result);
  internal::PlaceReader<Dim> places(result);
  motion.acceleration = read_acceleration<Dim>(analysis, expressions);
  read_velocities<Dim>(velocities, expressions, motion);
  read_fractures<Dim>(fractures, motion);
  read_walls<Dim>(walls, motion);
  read_tools<Dim>(tools, file.parent_path(), root, result.geometry.grey, motion);
  read_moved<Dim>(boundaries, expressions, places, motion);
  read_functions(root, places, result);
  read_options(root.section("otm", {"gamma", "cutoff", "renewal", "exact_integration", "anisotropy", "merging",
                                    "injection", "momentum", "courant", "stabilisation", "imbalance", "shock"}),
               motion.cloud, motion.options);
  const Section contact = root.section("contact", {"stiffness", "friction", "seizing"});
  motion.options.contact.stiffness = contact.number("stiffness", not_negative, motion.options.contact.stiffness);
  motion.options.contact.friction = contact.number("friction", not_negative, motion.options.contact.friction);
  motion.options.contact.seizing = contact.boolean("seizing", false);
  for (const char* key : {"stiffness", "friction"})
    if (motion.options.contact.seizing && contact.has(key))
      contact.fail(key, fmt::format("{} means nothing for bodies that seize", key));
  if (motion.options.contact.seizing && motion.cloud)
    contact.fail("seizing", "seizing is for functions that are made anew, and those of a [cloud] are not");
  for (const Section& entry : gases)
    motion.gases.push_back({.on = places.name(entry),
                            .pressure = entry.number("pressure", any_number),
                            .exponent = entry.number("exponent", positive, GasInside{}.exponent),
                            .where = entry.where("on")});
  motion.end = time.number("end", positive);
  motion.max_step = time.number("max_step", positive, motion.max_step);
  motion.min_step = time.number("min_step", {0.0, motion.max_step, false, true}, motion.min_step);
  motion.frames = static_cast<Index>(output.integer("frames", 0, 100000, motion.frames));
  motion.lines = static_cast<Index>(output.integer("history", 0, 10000000, motion.lines));
  motion.checkpoint = output.number("checkpoint", positive, motion.checkpoint);
  motion.colour = output.text("colour", "");
  read_probes<Dim>(probes, root.section("definitions", {}), expressions, motion);
  toml::table what = table;
  what.erase("time");
  what.erase("output");
  internal::Fingerprint mark;
  mark.add(internal::text_of(toml::node_view<const toml::node>(what)));
  if (geometry.has("file")) internal::add_file(mark, file.parent_path() / geometry.text("file"));
  for (const Section& tool : tools)
    if (tool.has("file")) internal::add_file(mark, file.parent_path() / tool.text("file"));
  result.mark = {mark.value(), 0};
  return result;
}

}  // namespace

bool is_otm_case(const std::filesystem::path& file) {
  return moves(internal::parse_toml(file.string()));
}

AnyOtmCase read_otm_case(const std::filesystem::path& file, const Reading& reading, const Monitor& monitor) {
  const toml::table table = internal::parse_toml(file.string());
  const Section root(table, "", file.string(),
                     {"title", "definitions", "geometry", "cloud", "quadrature", "analysis", "material", "velocity",
                      "fracture", "wall", "tool", "boundary", "gas", "contact", "probe", "time", "otm", "output"});
  const Section geometry = root.required_section("geometry", internal::geometry_keys());
  const Section analysis = root.required_section("analysis", otm_analysis_keys);
  if (!moves(table)) analysis.fail("kind", "kind: expected \"otm\"");
  if (internal::geometry_dimension(geometry, file.parent_path(), analysis.has("plane"), reading, monitor) == 2)
    return read<2>(file, table, root, geometry, reading);
  return read<3>(file, table, root, geometry, reading);
}

}  // namespace efree
