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
void read_conductivities(const Section& root, EffectiveSettings& result) {
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

EffectiveCase read_effective(const CaseText& text) {
  const Section& root = text.root;
  const Section analysis = root.section("analysis", {"kind", "plane"});
  const Section effective = root.section("effective", {"property", "boundary", "subvolumes", "interfaces"});
  EffectiveCase result;
  result.common.where = text.file.string();
  result.common.said = places_in(root);
  result.common.title = root.text("title", text.file.stem().string());
  result.common.model.plane = Plane::strain;
  if (analysis.has("plane")) analysis.fail("plane", "effective properties are those in space: leave it out");
  result.property = effective.choice<EffectiveProperty>(
      "property", {{"stiffness", EffectiveProperty::stiffness}, {"conductivity", EffectiveProperty::conductivity}},
      EffectiveProperty::stiffness);
  result.frame = effective.choice<FrameCondition>("boundary",
                                                  {{"periodic", FrameCondition::periodic},
                                                   {"kinematic", FrameCondition::kinematic},
                                                   {"static", FrameCondition::uniform}},
                                                  FrameCondition::periodic);
  result.subvolumes = static_cast<Index>(effective.integer("subvolumes", 1, 100, 1));
  result.smooth = effective.choice<bool>("interfaces", {{"smooth", true}, {"voxels", false}}, true);
  result.size = text.geometry.number("mesh_size", positive, 0.0);
  result.geometry = read_geometry<3>(text.geometry, text.folder(), text.reading);
  if (!result.geometry.image && result.geometry.grey)
    text.geometry.fail("image", "images in space are solved on the grid of their voxels here: leave the mesher out");
  if (!result.geometry.image)
    for (const char* key : {"subvolumes", "interfaces"})
      if (effective.has(key))
        effective.fail(key, fmt::format("{} is for images in space; this geometry is a mesh", key));
  if (result.property == EffectiveProperty::conductivity) {
    read_conductivities(root, result);
    return result;
  }
  const Expressions<3> expressions = read_definitions<3>(
      root, result.geometry.grey, {std::nullopt, "nothing depends on time in effective properties"});
  MaterialReader<3>(expressions).read(root, result.common);
  return result;
}

}  // namespace efree::internal
