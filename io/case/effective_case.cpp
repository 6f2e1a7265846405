// SPDX-License-Identifier: GPL-3.0-or-later
/// Effective properties of images and unit cells.
#include "efree/io/case/internal/case_readers.hpp"
#include "efree/io/case/internal/material_reader.hpp"
#include "efree/io/case/internal/read_geometry.hpp"

#include <fmt/format.h>
#include <utility>

namespace efree::internal {
namespace {

/// [material] or [[material]] conductivity.
template <int Dim> void read_conductivities(const Section& root, EffectiveSettings<Dim>& result) {
  const auto value = [](const Section& section) {
    if (!section.has("conductivity"))
      section.fail("", "key \"conductivity\" is missing: effective.property = \"conductivity\" asks for it");
    return section.number("conductivity", not_negative);
  };
  if (!root.has("material") || root.is_table("material")) {
    const Section section = root.required_section("material", material_keys());
    result.conductivities.push_back({"", value(section), section.where()});
    return;
  }
  Section::Keys keys = material_keys();
  keys.push_back("region");
  for (const Section& section : root.sections("material", keys)) {
    const std::string region = section.text("region");
    for (const auto& earlier : result.conductivities)
      if (earlier.region == region)
        section.fail("region", fmt::format("the region \"{}\" has a material already, from {}", region, earlier.where));
    result.conductivities.push_back({region, value(section), section.where("region")});
  }
}

}  // namespace

Section::Keys effective_keys() {
  return {"title", "definitions", "geometry", "analysis", "material", "effective"};
}

template <int Dim> EffectiveCase<Dim> read_effective(const CaseText& text) {
  const Section& root = text.root;
  const Section analysis = root.section("analysis", {"kind", "plane"});
  const Section effective = root.section("effective", {"property", "boundary", "subvolumes", "interfaces"});
  EffectiveCase<Dim> result;
  if (text.geometry.has("mesh_ratio"))
    text.geometry.fail("mesh_ratio",
                       "mesh_ratio is relative to a cloud, which effective properties do not have: take mesh_size");
  result.property = effective.choice<EffectiveProperty>(
      "property", {{"stiffness", EffectiveProperty::stiffness}, {"conductivity", EffectiveProperty::conductivity}},
      EffectiveProperty::stiffness);
  std::optional<Plane> plane;  // of a conductivity it says no more than that the geometry is planar
  if (result.property == EffectiveProperty::conductivity) plane = Plane::strain;
  read_common(text, analysis, {{"strain", Plane::strain}, {"stress", Plane::stress}}, result.common, result.geometry,
              plane);
  result.frame = effective.choice<FrameCondition>("boundary",
                                                  {{"periodic", FrameCondition::periodic},
                                                   {"kinematic", FrameCondition::kinematic},
                                                   {"static", FrameCondition::uniform}},
                                                  FrameCondition::periodic);
  result.subvolumes = static_cast<Index>(effective.integer("subvolumes", 1, 100, 1));
  result.smooth = effective.choice<bool>("interfaces", {{"smooth", true}, {"voxels", false}}, true);
  result.size = text.geometry.number("mesh_size", positive, 0.0);
  if (Dim == 3 && !result.geometry.image && result.geometry.grey)
    text.geometry.fail("image", "images in space are solved on the grid of their voxels here: leave the mesher out");
  if (Dim == 2 || !result.geometry.image)
    for (const char* key : {"subvolumes", "interfaces"})
      if (effective.has(key))
        effective.fail(
            key, fmt::format("{} is for images in space; this geometry is {}", key, Dim == 2 ? "planar" : "a mesh"));
  if (result.property == EffectiveProperty::conductivity) {
    read_conductivities(root, result);
    return result;
  }
  const Expressions<Dim> expressions = read_definitions<Dim>(
      root, result.geometry.grey, {std::nullopt, "nothing depends on time in effective properties"});
  MaterialReader<Dim>(expressions).read(root, result.common);
  return result;
}

template EffectiveCase<2> read_effective(const CaseText&);
template EffectiveCase<3> read_effective(const CaseText&);

}  // namespace efree::internal
