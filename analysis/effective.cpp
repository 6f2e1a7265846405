// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/analysis/effective.hpp"

#include "efree/analysis/internal/located.hpp"
#include "efree/analysis/internal/memory.hpp"
#include "efree/analysis/internal/prepare_mesh.hpp"
#include "efree/analysis/internal/resolutions.hpp"
#include "efree/assembly/materials.hpp"
#include "efree/core/error.hpp"
#include "efree/core/internal/clock.hpp"
#include "efree/core/internal/spectrum.hpp"
#include "efree/materials/linear_elastic.hpp"
#include "efree/solvers/algorithms/unit_cell.hpp"
#include "efree/solvers/cells/cell_solver.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <algorithm>
#include <cmath>
#include <utility>

namespace efree {
namespace {

using internal::said_at;

/// Part of the mean moduli below which there are none.
constexpr double none_of_mean = 1e-6;
/// Distance from a class of symmetry that counts as none.
constexpr double class_tolerance = 0.01;

/// Share of a side of the frame that faces void, from which on a body is not periodic.
constexpr double not_periodic = 0.01;

/// What each label is made of: materials, or conductivities.
struct Phases {
  std::vector<SharedMaterial> materials;
  std::vector<double> conductivities;
};

/// An entry for the region of each label; `entries` with a region that is not in the image are rejected.
template <class Entry, class F> void for_regions(const MadeImage<3>& image, const std::vector<Entry>& entries,
                                                 const std::string& kind, const std::string& where, const F& take) {
  for (const auto& [label, name] : image.region_of_label) {
    const auto found = std::ranges::find(entries, name, &Entry::region);
    if (found == entries.end())
      throw InputError(said_at(where, fmt::format("no {} for the region \"{}\" of the image", kind, name)));
    take(label, *found);
  }
  for (const Entry& entry : entries) {
    const auto is_it = [&](const auto& region) { return region.second == entry.region; };
    if (std::ranges::any_of(image.region_of_label, is_it)) continue;
    std::vector<std::string> names;
    for (const auto& region : image.region_of_label) names.push_back(region.second);
    throw InputError(said_at(entry.where, fmt::format("there is no region \"{}\" in the image, which has {}",
                                                      entry.region, fmt::join(names, ", "))));
  }
}

Phases phases_of(const EffectiveSettings& settings, const MadeImage<3>& image) {
  Phases phases;
  const std::size_t labels = image.region_of_label.empty() ? 1 : image.region_of_label.rbegin()->first + 1;
  if (settings.property == EffectiveProperty::stiffness) {
    phases.materials.resize(labels);
    if (settings.common.materials.empty())
      for (const auto& region : image.region_of_label) phases.materials[region.first] = settings.common.model.material;
    else
      for_regions(image, settings.common.materials, "[[material]]", settings.common.materials.back().where,
                  [&](Label label, const RegionMaterial& one) { phases.materials[label] = one.material; });
    return phases;
  }
  phases.conductivities.assign(labels, 0.0);
  const auto& said = settings.conductivities;
  if (said.empty()) throw InputError(said_at(settings.common.where, "no conductivity is given"));
  if (said.size() == 1 && said.front().region.empty())
    for (const auto& region : image.region_of_label) phases.conductivities[region.first] = said.front().value;
  else
    for_regions(image, said, "conductivity", said.back().where,
                [&](Label label, const RegionConductivity& one) { phases.conductivities[label] = one.value; });
  return phases;
}

/// The conductivity of a region of a mesh. Throws InputError for a region that has none.
double conductivity_of(const EffectiveSettings& settings, const std::string& region) {
  for (const RegionConductivity& one : settings.conductivities)
    if (one.region.empty() || one.region == region) return one.value;
  throw InputError(said_at(settings.common.where, fmt::format("no conductivity for the region \"{}\"", region)));
}

EffectiveTensor solve(const EffectiveSettings& settings, const LabelImage<3>& image, const Phases& phases,
                      FrameCondition frame, double size, const Monitor& monitor) {
  const EffectiveOptions options{.frame = frame, .size = size, .smooth = settings.smooth};
  return settings.property == EffectiveProperty::stiffness
             ? effective_stiffness(image, phases.materials, options, monitor)
             : effective_conductivity(image, phases.conductivities, options, monitor);
}

/// Fractions by label, void included.
std::map<Label, double> fractions_of(const LabelImage<3>& image) {
  std::map<Label, double> fractions;
  for (const LabelCount& count : count_labels(image))
    fractions[count.label] = static_cast<double>(count.pixels) / static_cast<double>(image.labels.size());
  return fractions;
}

/// Bounds of phases with moduli m by fraction; `add(extreme)` is what Hashin-Shtrikman's bounds add to each modulus.
PhaseBounds bounds_of(const std::vector<std::pair<double, double>>& phases, double lower_add, double upper_add) {
  const auto generalised = [&](double add) {
    double sum = 0.0;
    for (const auto& [fraction, m] : phases) {
      if (m + add <= 0.0) return 0.0;
      sum += fraction / (m + add);
    }
    return 1.0 / sum - add;
  };
  double voigt = 0.0;
  for (const auto& [fraction, m] : phases) voigt += fraction * m;
  return {{generalised(0.0), voigt}, {generalised(lower_add), generalised(upper_add)}};
}

/// A part of the volume and what it is made of.
struct Phase {
  std::string region;  ///< "void": nothing
  double fraction;
  SharedMaterial material{};
  double conductivity = 0.0;
};

void find_bounds(const EffectiveSettings& settings, const std::vector<Phase>& phases, EffectiveResult& result) {
  std::vector<std::pair<double, double>> first, second;  // kappa and mu, or conductivities
  for (const Phase& phase : phases) {
    if (settings.property == EffectiveProperty::conductivity) {
      first.emplace_back(phase.fraction, phase.conductivity);
      continue;
    }
    double kappa = 0.0, mu = 0.0;
    if (phase.material) {
      if (!phase.material->homogeneous() || !is_isotropic(phase.material, Vec<3>::Zero())) return;
      const VoigtMatrix<3> C = Materials<3>({phase.material}, Plane::strain).stiffness(0, Vec<3>::Zero()).C;
      mu = C(5, 5);
      if (C(0, 1) > 9.0 * mu)  // nu > 0.45
        result.warnings.push_back(
            fmt::format("the stiffness may be too high: \"{}\" is nearly incompressible, and {} lock", phase.region,
                        result.on_mesh ? "quadratic elements" : "trilinear cells"));
      kappa = C(0, 1) + 2.0 / 3.0 * mu;
    }
    first.emplace_back(phase.fraction, kappa);
    second.emplace_back(phase.fraction, mu);
  }
  const auto extremes = [](const auto& moduli) {
    const auto [low, high] = std::ranges::minmax(moduli, {}, [](const auto& one) { return one.second; });
    return std::pair(low.second, high.second);
  };
  const auto [low, high] = extremes(first);
  if (settings.property == EffectiveProperty::conductivity) {
    result.conductivity_bounds = bounds_of(first, 2.0 * low, 2.0 * high);
    return;
  }
  const auto [soft, stiff] = extremes(second);
  const auto zeta = [](double kappa, double mu) {
    return mu > 0.0 ? mu / 6.0 * (9.0 * kappa + 8.0 * mu) / (kappa + 2.0 * mu) : 0.0;
  };
  result.kappa_bounds = bounds_of(first, 4.0 / 3.0 * soft, 4.0 / 3.0 * stiff);
  result.mu_bounds = bounds_of(second, zeta(low, soft), zeta(high, stiff));
}

/// Norm of a stiffness or conductivity.
double size_of(const Matrix& tensor) {
  return tensor.rows() == 6 ? norm_of(ElasticTensor(tensor)) : tensor.norm();
}

/// Compliance or resistivity, unless it is infinite along something.
Matrix inverse_of(const Matrix& tensor, const Matrix& mean) {
  // Scaled by the mean moduli, so that soft axes of stiff bodies do not count as none.
  const Vector scale = mean.diagonal().cwiseSqrt().cwiseInverse();
  const Matrix scaled = scale.asDiagonal() * tensor * scale.asDiagonal();
  if (!(internal::eigenvalues<Eigen::Dynamic>(scaled)[0] > none_of_mean)) return {};
  return scale.asDiagonal() * internal::pseudo_inverse<Eigen::Dynamic>(scaled) * scale.asDiagonal();
}

void interpret(EffectiveResult& result) {
  const Matrix& tensor = result.tensor.tensor;
  const bool is_elastic = tensor.rows() == 6;
  bool any = false;
  for (int d = 0; d < tensor.rows(); ++d) {
    const bool is_none = !(tensor(d, d) > none_of_mean * result.tensor.mean(d, d));
    if (d < 3) result.is_cut[d] = is_none;
    any = any || !is_none;
  }
  const char* what = is_elastic ? "stiffness" : "conductivity";
  if (!any)
    throw InputError(
        fmt::format("the volume has no {0}: void cuts it along all axes, so that nothing in it hangs together from one "
                    "side to the other. A threshold that leaves more material, or another part of the image, may help",
                    what));
  for (int d = 0; d < 3; ++d)
    if (result.is_cut[d])
      result.warnings.push_back(
          fmt::format("there is no {} along {}: void cuts the volume across this axis", what, "xyz"[d]));
  result.inverse = inverse_of(tensor, result.tensor.mean);
  if (is_elastic) {
    const ElasticTensor C = tensor;
    result.symmetry = symmetry_of(C);
    result.class_tolerance = std::max(class_tolerance, 2.0 * result.tensor.grid_error);
    result.nearest = nearest_class(*result.symmetry, result.class_tolerance);
    if (result.inverse.size() > 0)
      result.universal_anisotropy = universal_anisotropy(C, ElasticTensor(result.inverse));
    else
      result.warnings.emplace_back("the stiffness is singular: there are no engineering constants");
    return;
  }
  const auto [values, vectors] = internal::spectrum<3>(Mat<3>(tensor));
  for (int d = 0; d < 3; ++d) {
    result.principal[d] = values[2 - d];
    result.principal_axes.col(d) = vectors.col(2 - d);
    if (result.principal_axes.col(d).sum() < 0.0) result.principal_axes.col(d) *= -1.0;
  }
}

LabelImage<3> part_of(const LabelImage<3>& image, const std::array<Index, 3>& size, const std::array<Index, 3>& at) {
  LabelImage<3> part;
  part.size = size;
  part.spacing = image.spacing;
  for (int d = 0; d < 3; ++d) part.origin[d] = image.origin[d] + at[d] * size[d] * image.spacing[d];
  for (Index k = 0; k < size[2]; ++k)
    for (Index j = 0; j < size[1]; ++j)
      for (Index i = 0; i < size[0]; ++i) {
        const std::size_t from = image.index({at[0] * size[0] + i, at[1] * size[1] + j, at[2] * size[2] + k});
        part.labels.push_back(image.labels[from]);
        if (!image.grey.empty()) part.grey.push_back(image.grey[from]);
      }
  return part;
}

/// Whether nothing in a part carries or conducts.
bool is_empty_part(const LabelImage<3>& part, const Phases& phases) {
  return std::ranges::none_of(part.labels, [&](Label label) {
    return label != 0 && (phases.conductivities.empty() || phases.conductivities[label] > 0.0);
  });
}

SubvolumeStatistics statistics_of_subvolumes(const EffectiveSettings& settings, const LabelImage<3>& image,
                                             const Phases& phases, const EffectiveTensor& of_whole,
                                             const Monitor& monitor) {
  const Index n = settings.subvolumes;
  const Matrix& whole = of_whole.tensor;
  const double cell = of_whole.finest().edges.minCoeff();
  std::array<Index, 3> size;
  for (int d = 0; d < 3; ++d) size[d] = image.size[d] / n;
  const FrameCondition frame =
      settings.frame == FrameCondition::periodic ? FrameCondition::periodic : FrameCondition::kinematic;
  const Stage stage("subvolumes", monitor);
  SubvolumeStatistics result{.count = n * n * n};
  std::vector<Matrix> tensors;
  for (Index p = 0; p < result.count; ++p) {
    const LabelImage<3> part = part_of(image, size, {p % n, p / n % n, p / n / n});
    tensors.push_back(is_empty_part(part, phases) ? Matrix(Matrix::Zero(whole.rows(), whole.cols()))
                                                  : solve(settings, part, phases, frame, cell, stage.within()).tensor);
    stage.tick(static_cast<double>(p + 1) / result.count);
  }
  result.mean = result.deviation = Matrix::Zero(whole.rows(), whole.cols());
  for (const Matrix& one : tensors) result.mean += one / result.count;
  for (const Matrix& one : tensors) result.deviation += (one - result.mean).cwiseAbs2() / (result.count - 1.0);
  result.deviation = result.deviation.cwiseSqrt().eval();
  if (const double norm = size_of(result.mean); norm > 0.0) result.spread = size_of(result.deviation) / norm;
  result.bias = size_of(result.mean - whole) / size_of(whole);
  result.expected_spread = result.spread / std::sqrt(static_cast<double>(result.count));
  return result;
}

/// Of a unit cell on one mesh; sets what it found.
EffectiveLevel level_on(const EffectiveSettings& settings, const PreparedMesh<3>& prepared, BasisKind kind,
                        UnitCellTensor& found) {
  const internal::Stopwatch seconds;
  const FineMesh<3>& mesh = *prepared.mesh;
  const Approximation<3> elements = approximate(prepared.mesh, {.kind = kind, .dilatation = Dilatation::pointwise});
  if (settings.property == EffectiveProperty::stiffness) {
    found = effective_stiffness(elements, Materials<3>(prepared.materials, Plane::strain), settings.frame);
  } else {
    std::vector<double> by_region;
    for (const std::string& name : mesh.region_names()) by_region.push_back(conductivity_of(settings, name));
    found = effective_conductivity(elements, by_region, settings.frame);
  }
  const double edge = internal::mean_edge(mesh);
  return {.edges = Vec<3>::Constant(edge), .cells = mesh.num_cells(), .tensor = found.tensor, .seconds = seconds()};
}

/// What the regions of a unit cell and the void around them have of the box.
std::vector<Phase> phases_of(const EffectiveSettings& settings, const PreparedMesh<3>& prepared) {
  const FineMesh<3>& mesh = *prepared.mesh;
  const double frame = (mesh.vertices().rowwise().maxCoeff() - mesh.vertices().rowwise().minCoeff()).prod();
  std::vector<Phase> phases;
  for (Index r = 0; r < mesh.num_regions(); ++r) {
    const std::string& name = mesh.region_names()[r];
    if (settings.property == EffectiveProperty::stiffness)
      phases.push_back({name, 0.0, prepared.materials[r]});
    else
      phases.push_back({name, 0.0, {}, conductivity_of(settings, name)});
  }
  double filled = 0.0;
  for (Index c = 0; c < mesh.num_cells(); ++c) {
    phases[mesh.region(c)].fraction += mesh.volume(c) / frame;
    filled += mesh.volume(c) / frame;
  }
  if (filled < 1.0 - 1e-9) phases.push_back({"void", 1.0 - filled});
  return phases;
}

}  // namespace

EffectiveResult find_effective(const EffectiveSettings& settings, const MadeImage<3>& image,
                               const Monitor& monitor_of_run) {
  EffectiveResult result;
  const Monitor monitor = monitor_of_run.timing(result.times);
  check_image(image.image);
  const Phases phases = phases_of(settings, image);
  if (settings.subvolumes > 1)
    for (int d = 0; d < 3; ++d)
      if (image.image.size[d] % settings.subvolumes != 0)
        throw InputError(said_at(settings.common.said.contains("effective.subvolumes")
                                     ? settings.common.said.at("effective.subvolumes")
                                     : "",
                                 fmt::format("subvolumes is {}, which does not divide the {} voxels along {}",
                                             settings.subvolumes, image.image.size[d], "xyz"[d])));
  std::vector<Phase> shares;
  for (const auto& [label, fraction] : fractions_of(image.image)) {
    shares.push_back({label == 0 ? "void" : image.region_of_label.at(label), fraction});
    if (label == 0) continue;
    if (settings.property == EffectiveProperty::stiffness)
      shares.back().material = phases.materials[label];
    else
      shares.back().conductivity = phases.conductivities[label];
  }
  for (const Phase& share : shares) result.fractions.push_back({share.region, share.fraction});
  result.tensor = solve(settings, image.image, phases, settings.frame, settings.size, monitor);
  interpret(result);
  find_bounds(settings, shares, result);
  if (settings.subvolumes > 1)
    result.subvolumes = statistics_of_subvolumes(settings, image.image, phases, result.tensor, monitor);
  if ((result.tensor.finest().edges - image.image.spacing).maxCoeff() > 1e-9 * image.image.spacing.maxCoeff())
    result.warnings.emplace_back(
        "the error of the grid may be larger than reported: cells hold several voxels, and boundaries between labels "
        "cut them");
  result.warnings.insert(result.warnings.end(), image.warnings.begin(), image.warnings.end());
  if (image.image.is_turned())
    result.warnings.emplace_back("the image is turned: the tensor is in its own axes, not in those of the world");
  if (result.tensor.grid_error > 0.05)
    result.warnings.push_back(
        fmt::format("the tensor may be {:.0f} % off: cells are too large for what the image shows",
                    100.0 * result.tensor.grid_error));
  return result;
}

EffectiveResult find_effective(const EffectiveSettings& settings, const MeshSource<3>& source,
                               const Monitor& monitor_of_run) {
  EffectiveResult result;
  result.on_mesh = true;
  const Monitor monitor = monitor_of_run.timing(result.times);
  CommonSettings<3> common = settings.common;
  common.approximation.kind = BasisKind::p2;
  if (settings.property == EffectiveProperty::conductivity) common.model.material = LinearElastic(1.0, 0.0);
  std::optional<PreparedMesh<3>> finest;
  UnitCellTensor on_finest;
  for (const double coarser : {4.0, 2.0, 1.0}) {
    MeshSource<3> of_size = source;
    of_size.size *= coarser;
    of_size.coarsening *= coarser;
    try {
      PreparedMesh<3> prepared = internal::prepare_mesh<3>(of_size, common, nullptr, monitor);
      if (coarser == 1.0) {
        for (const std::string& remark : prepared.remarks)
          if (monitor.say) monitor.say(remark);
        if (!internal::has_memory_for_quadratic_elements(*prepared.mesh))
          throw InputError(said_at(source.where, fmt::format("{} quadratic cells take more memory than there is: take "
                                                             "a larger geometry.mesh_size",
                                                             prepared.mesh->num_cells())));
      }
      const Stage stage("solve", monitor);
      result.tensor.levels.insert(result.tensor.levels.begin(), level_on(settings, prepared, BasisKind::p2, on_finest));
      finest = std::move(prepared);
    } catch (const InputError&) {
      if (coarser == 1.0) throw;  // too coarse for the geometry
    } catch (const NumericalError&) {
      if (coarser == 1.0) throw;
    }
  }
  EffectiveTensor& found = result.tensor;
  found.tensor = on_finest.tensor;
  found.mean = on_finest.mean;
  if (monitor.say)
    for (const int axis : on_finest.coupled_axes)
      monitor.say(fmt::format("opposite sides along {} have other meshes: periodic by Nitsche's method", "xyz"[axis]));
  if (on_finest.uncovered > not_periodic)
    result.warnings.push_back(fmt::format(
        "the tensor may not be that of a periodic body: on opposite sides of the frame up to {:.2g} % of the "
        "area is material with void opposite, which is free",
        100.0 * on_finest.uncovered));
  const auto coarsening = [&](std::size_t a, std::size_t b) {
    return std::cbrt(static_cast<double>(found.levels[a].cells) / found.levels[b].cells);
  };
  estimate_grid_error(found, coarsening, false, 1.0);
  if (coarsening(0, found.levels.size() - 1) < 1.6) {  // the file has its mesh
    const Matrix linear = level_on(settings, *finest, BasisKind::p1, on_finest).tensor;
    found.grid_error = (linear - found.tensor).norm() / std::max(found.tensor.norm(), 1e-300);
    result.warnings.emplace_back(
        "there is no coarser mesh of this geometry: the error is the distance from linear elements, which is far more "
        "than that of quadratic ones");
  }
  const std::vector<Phase> phases = phases_of(settings, *finest);
  for (const Phase& phase : phases) result.fractions.push_back({phase.region, phase.fraction});
  interpret(result);
  find_bounds(settings, phases, result);
  result.warnings.insert(result.warnings.end(), finest->warnings.begin(), finest->warnings.end());
  if (found.grid_error > 0.05)
    result.warnings.push_back(
        fmt::format("the tensor may be {:.0f} % off: take a smaller geometry.mesh_size", 100.0 * found.grid_error));
  return result;
}

}  // namespace efree
