// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/io/case/internal/rigid_reader.hpp"
#include "efree/io/case/internal/function_of_time.hpp"

#include "efree/core/error.hpp"
#include "efree/geometry/input/image_reader.hpp"
#include "efree/geometry/input/terrain.hpp"
#include "efree/io/case/internal/function_of_time.hpp"

#include <fmt/format.h>
#include <algorithm>
#include <limits>

namespace efree::internal {
namespace {

double read_friction(const Section& entry) {
  if (entry.has("friction") && entry.table().get("friction")->is_string())
    return entry.choice<double>("friction", {{"stick", std::numeric_limits<double>::infinity()}}, {});
  return entry.number("friction", not_negative, 0.0);
}

/// What `read` makes of the file of an entry.
template <class Read> auto read_file(const Section& entry, const std::filesystem::path& folder, const Read& read) {
  const std::string path = (folder / entry.text("file")).string();
  try {
    return read(path);
  } catch (const InputError& error) {
    entry.fail("file", error.what());
  }
}

/// Heights of a terrain: the grey values of an image.
GreyImage<2> read_heights(const Section& entry, const std::filesystem::path& folder) {
  const ImageOptions<2> options{.spacing = read_pixel_spacing(entry, 2)};
  GreyImage<2> image =
      read_file(entry, folder, [&](const std::string& path) { return read_grey_image<2>(path, options); });
  if (!image.axes.isIdentity(0.0)) entry.fail("file", "a terrain's image is turned, expected axes along x and y");
  if (entry.has("origin")) image.origin = entry.point<2>("origin");
  const double height = entry.number("height", positive, 1.0), level = entry.number("level", any_number, 0.0);
  for (float& value : image.values) value = static_cast<float>(level + height * static_cast<double>(value));
  return image;
}

template <int Dim>
RigidShape<Dim> read_shape(const Section& entry, const std::filesystem::path& folder, RigidBody<Dim>& body) {
  const std::string name = entry.text("shape");
  const auto allow = [&](const Section::Keys& keys) {
    for (const char* key : {"normal", "level", "radius", "axis", "points", "file", "height", "origin", "spacing"})
      if (entry.has(key) && std::ranges::find(keys, key) == keys.end())
        entry.fail(key, fmt::format("{} means nothing for a rigid body of shape \"{}\"", key, name));
  };
  if (entry.has("centre")) body.centre = entry.template point<Dim>("centre");
  if (name == "plane") {
    allow({"normal", "level"});
    return rigid_shapes::half_space<Dim>(entry.template direction<Dim>("normal"),
                                         entry.number("level", any_number, 0.0));
  }
  if (name == "ball") {
    allow({"radius"});
    body.corners = entry.template point<Dim>("centre");
    body.round = entry.number("radius", positive);
    return rigid_shapes::ball<Dim>(body.centre, body.round);
  }
  if constexpr (Dim == 2) {
    if (name == "polygon") {
      allow({"points"});
      const auto corners = entry.pairs("points");
      if (corners.size() < 3) entry.fail("points", "points: expected three corners and more");
      Points<2> at(2, static_cast<Index>(corners.size()));
      for (std::size_t k = 0; k < corners.size(); ++k) at.col(static_cast<Index>(k)) << corners[k][0], corners[k][1];
      body.corners = at;
      return rigid_shapes::solid<2>(at, rigid_shapes::polygon(static_cast<Index>(corners.size())));
    }
  } else {
    if (name == "cylinder") {
      allow({"radius", "axis"});
      return rigid_shapes::cylinder(entry.template point<3>("centre"), entry.template direction<3>("axis"),
                                    entry.number("radius", positive));
    }
    if (name == "surface") {
      allow({"file"});
      const SurfaceSoup surface = read_file(entry, folder, read_surface);
      body.corners = surface.points;
      return rigid_shapes::solid(surface);
    }
    if (name == "heights") {
      allow({"file", "height", "level", "origin", "spacing"});
      return rigid_shapes::solid(terrain(read_heights(entry, folder)));
    }
  }
  entry.fail("shape", fmt::format("shape is \"{}\", expected \"plane\", \"ball\", {}", name,
                                  Dim == 2 ? "\"polygon\"" : "\"cylinder\", \"surface\", \"heights\""));
}

/// The axes that are not named.
template <int Dim> std::array<bool, Dim> read_held_axes(const Section& entry) {
  std::array<bool, Dim> held;
  held.fill(true);
  for (const std::string& name : entry.texts("free")) {
    const std::size_t axis =
        name.size() == 1 ? std::string_view("xyz").substr(0, Dim).find(name[0]) : std::string::npos;
    if (axis == std::string_view::npos)
      entry.fail("free",
                 fmt::format("free names \"{}\", expected axes: \"x\", \"y\"{}", name, Dim == 3 ? ", \"z\"" : ""));
    held[axis] = false;
  }
  return held;
}

}  // namespace

template <int Dim> void read_walls(const std::vector<Section>& entries, DynamicsSettings<Dim>& dynamics) {
  for (const Section& entry : entries) {
    Wall<Dim> wall{.normal = entry.template direction<Dim>("normal")};
    wall.level = entry.number("level", any_number, 0.0);
    wall.friction = read_friction(entry);
    dynamics.walls.push_back({wall, entry.where("normal")});
  }
}

template <int Dim> void read_rigid_bodies(const std::vector<Section>& entries, const std::filesystem::path& folder,
                                          const Section& root, const ScalarField<Dim>& grey,
                                          DynamicsSettings<Dim>& dynamics) {
  constexpr int spins = Dim == 2 ? 1 : 3;
  for (const Section& entry : entries) {
    RigidBody<Dim> body;
    try {
      body.shape = read_shape<Dim>(entry, folder, body);
    } catch (const InputError& error) {
      if (std::string(error.what()).starts_with("a ")) entry.fail("shape", error.what());
      throw;
    }
    body.friction = read_friction(entry);
    if (entry.has("velocity"))
      body.velocity =
          read_function_of_time<Dim, Dim>(entry.expressions<Dim>("velocity"), entry, "velocity", root, grey);
    if (entry.has("spin")) {
      std::array<std::string, spins> spin;
      if constexpr (Dim == 2)
        spin[0] = entry.expression("spin");
      else
        spin = entry.expressions<3>("spin");
      body.spin = read_function_of_time<Dim, spins>(spin, entry, "spin", root, grey);
    }
    body.mass = entry.number("mass", positive, 0.0);
    body.inertia = entry.number("inertia", positive, 0.0);
    for (const char* of_free : {"free", "force"})
      if (entry.has(of_free) && body.mass == 0.0)
        entry.fail(of_free, fmt::format("{} is of a rigid body with a mass, and there is none", of_free));
    if (entry.has("free")) body.held = read_held_axes<Dim>(entry);
    if (entry.has("force"))
      body.force = read_function_of_time<Dim, Dim>(entry.expressions<Dim>("force"), entry, "force", root, grey);
    if ((body.spin || body.inertia > 0.0) && !entry.has("centre"))
      entry.fail("spin", "key \"centre\" is missing: the point about which the rigid body rotates");
    dynamics.rigid_bodies.push_back({body, entry.where("shape")});
  }
}

#define EFREE_INSTANTIATE(Dim)                                                                               \
  template void read_walls(const std::vector<Section>&, DynamicsSettings<Dim>&);                             \
  template void read_rigid_bodies(const std::vector<Section>&, const std::filesystem::path&, const Section&, \
                                  const ScalarField<Dim>&, DynamicsSettings<Dim>&);
EFREE_INSTANTIATE(2)
EFREE_INSTANTIATE(3)
#undef EFREE_INSTANTIATE

}  // namespace efree::internal
