// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/solvers/cells/internal/cell_problem.hpp"

#include "efree/core/error.hpp"
#include "efree/core/memory.hpp"
#include "efree/geometry/input/box_averages.hpp"
#include "efree/solvers/cells/internal/body_forces.hpp"
#include "efree/solvers/cells/internal/cell_loads.hpp"
#include "efree/solvers/cells/internal/cell_stiffness.hpp"
#include "efree/solvers/cells/internal/multigrid.hpp"

#include <fmt/format.h>
#include <cmath>
#include <map>
#include <numeric>
#include <string_view>

namespace efree {
namespace internal {
namespace {

using Triple = std::array<Index, 3>;

/// The facets of all parts that conditions and loads are on, and of the sides of the frame. Throws InputError for a
/// part that is none, or has no facets.
VoxelParts facets_by_part(const LabelImage<3>& image, const std::vector<Restraint<3>>& restraints,
                          const std::vector<Loads<3>>& cases, const VoxelParts& given) {
  const ImageBoundary boundary(image);
  VoxelParts parts;
  for (const std::string& side : side_names()) parts[side] = boundary.named(side);
  const auto add = [&](const std::string& name) {
    const auto found = given.find(name);
    const auto& facets = parts.try_emplace(name, found == given.end() ? boundary.named(name) : found->second).first;
    if (facets->second.empty()) throw InputError(fmt::format("the image has no material on \"{}\"", name));
  };
  for (const auto& restraint : restraints) add(restraint.on);
  for (const Loads<3>& loads : cases) {
    if (!loads.followers.empty())
      throw InputError(fmt::format("the pressure on \"{}\" follows the body, which cells take to be at rest",
                                   loads.followers.front().on));
    for (const auto& load : loads.tractions) add(load.on);
    for (const auto& load : loads.resultants) add(load.on);
  }
  return parts;
}

/// Cells along an axis of so many voxels, each so long: edges of at most `size`, and four at least. Where that is a
/// whole part of a voxel, cells are: boundaries, which lie within voxels or on their faces, are then where the image
/// has them. Elsewhere multiples of four, so that coarser grids have cells of whole finer ones, and differ from these
/// by their size only.
double cells_along(Index voxels, double voxel, double size) {
  const double parts = std::round(voxel / size);
  if (parts >= 1.0 && std::abs(parts * size / voxel - 1.0) < 1e-6 && parts * voxels >= 4.0) return parts * voxels;
  return 4.0 * std::ceil(std::ceil(voxels * voxel / size * (1.0 - 1e-7)) / 4.0);
}

/// Cells of the grids, from fine to coarse; 6 to 12 cells along each axis on the last, or as many as keep it small.
/// Each axis is halved, odd numbers rounded up, at least twice, as three grids tell the error. Throws InputError if
/// there is less `memory` [bytes to a point] than they take.
std::vector<Triple> grid_cells(const LabelImage<3>& image, double size, double memory) {
  constexpr double few = 2500.0;  // points, which are solved directly
  Triple n;
  std::array<int, 3> halvings;
  double points = 1.0;
  for (int d = 0; d < 3; ++d) {
    const double wanted = cells_along(image.size[d], image.spacing[d], size);
    halvings[d] = std::max(2, static_cast<int>(std::floor(std::log2(wanted / 6.0))));
    points *= wanted + 1.0 + (d == 0 ? 1.5 * CellGrid::lanes : 0.0);
    n[d] = static_cast<Index>(std::min(wanted, 1e9));
  }
  require_memory(memory * points, fmt::format("a grid of {} x {} x {} cells", n[0], n[1], n[2]),
                 "use larger cells (mesh_size)");
  std::vector<Triple> cells{n};
  const auto size_of = [](const Triple& c) { return (c[0] + 1.0) * (c[1] + 1.0) * (c[2] + 1.0); };
  while (cells.size() < 3 || size_of(cells.back()) > few) {
    bool any = false;
    for (int d = 0; d < 3; ++d)
      if (halvings[d]-- > 0) {
        n[d] = (n[d] + 1) / 2;
        any = true;
      }
    if (!any) break;
    cells.push_back(n);
  }
  return cells;
}

}  // namespace

CellProblem::CellProblem(CellGrid grid_, const Vec<3>& origin_, const Vec<3>& edges_, const Mat<3>& axes_,
                         Dilatation dilatation, const std::vector<Restraint<3>>& restraints_)
    : grid(std::move(grid_)),
      origin(origin_),
      edges(edges_),
      axes(axes_),
      dilatation_of_answers(dilatation),
      restraints(&restraints_) {}

Index CellProblem::num_cells() const {
  std::vector<Index> of_layer(grid.cells[2], 0);
  parallel_chunks(grid.cells[2], 4, [&](Index begin, Index end) {
    for (Index k = begin; k < end; ++k)
      for (Index j = 0; j < grid.cells[1]; ++j)
        for (Index i = 0; i < grid.cells[0]; ++i) of_layer[k] += grid.has_material(i, j, k);
  });
  return std::accumulate(of_layer.begin(), of_layer.end(), Index(0));
}

namespace {

/// How much of each part of a grid is material: noted while stiffnesses are found, if these tell it.
class SolidParts {
 public:
  SolidParts(const LabelImage<3>& image, const LabelStiffness& stiffness, const PartsOfImage& of_image,
             const Triple& cells)
      : of_image_(of_image), layer_(8 * static_cast<std::size_t>(cells[0]) * cells[1]) {
    if (of_image.solid_over_shear())
      parts_.resize(layer_ * cells[2]);
    else
      parts_ = box_averages(image, stiffness.solid, {2 * cells[0], 2 * cells[1], 2 * cells[2]});
  }
  /// Stiffnesses of the layers [begin, end) of cells.
  Parts layers(Index begin, Index end) {
    Parts parts = of_image_.layers(begin, end);
    if (const auto ratio = of_image_.solid_over_shear())
      for_all(parts.shear.size(), [&](std::size_t i) { parts_[layer_ * begin + i] = *ratio * parts.shear[i]; });
    return parts;
  }
  /// By part, once all layers have been asked for.
  std::vector<float> take() && { return std::move(parts_); }

 private:
  const PartsOfImage& of_image_;
  std::size_t layer_;
  std::vector<float> parts_;
};

/// Of a grid whose supports leave the body free: its corrections are held by weak springs everywhere, and it has no
/// solution of its own.
void add_weak_springs(CellProblem& problem) {
  constexpr float little = 1e-3F;  // of the diagonal
  problem.holds = false;
  for (std::size_t i = 0; i < problem.size(); ++i)
    if (problem.is_free(i)) problem.added.emplace_back(i, little / problem.inverse_diagonal[i]);
}

/// Sets the loads of all cases. Returns what they are, by case.
std::vector<std::vector<AppliedLoad<3>>> set_loads(CellProblem& problem, const std::vector<Loads<3>>& cases,
                                                   const PartPatches& patches, const BodyForces& forces, double unit) {
  std::vector<std::vector<AppliedLoad<3>>> applied(cases.size());
  const bool pull = problem.springs.pull();
  for (std::size_t c = 0; c < cases.size(); ++c) {
    Field& load = problem.loads.emplace_back();
    if (!cases[c].any() && !pull) continue;
    load = zeros<double>(problem.grid.size());
    applied[c] = add_loads(problem, cases[c], patches, load);
    for (AppliedLoad<3>& one : forces.add(problem, c, load)) applied[c].push_back(std::move(one));
    for_all(load.size(), [&](std::size_t i) { load[i] /= unit; });
    problem.springs.add_pull(load.data());
  }
  return applied;
}

}  // namespace

CellProblems make_cell_problems(const LabelImage<3>& image, const std::vector<SharedMaterial>& materials,
                                const std::vector<DisplacementCondition<3>>& conditions,
                                const std::vector<Loads<3>>& cases, const CellOptions& options) {
  check_image(image);
  if (!(options.size >= 0.0)) throw InputError(fmt::format("the size of cells is {}, expected > 0", options.size));
  Vec<3> lengths;
  for (int d = 0; d < 3; ++d) lengths[d] = image.size[d] * image.spacing[d];
  const LabelStiffness stiffness(image, materials);
  double memory = cell_memory + load_memory * static_cast<double>(std::ranges::count_if(cases, &Loads<3>::any));
  if (const auto anisotropic = stiffness.anisotropic.size(); anisotropic > 0)
    memory += anisotropic_memory + material_memory * static_cast<double>(anisotropic);
  const std::vector<Triple> cells =
      grid_cells(image, options.size > 0.0 ? options.size : 2.0 * image.spacing.maxCoeff(), memory);
  const double unit_length = lengths.cwiseQuotient(Vec<3>(cells[0][0], cells[0][1], cells[0][2])).maxCoeff();

  CellProblems problems{restraints(conditions),
                        {},
                        stiffness.unit * unit_length,
                        std::vector<std::vector<AppliedLoad<3>>>(cases.size()),
                        {}};
  const VoxelParts facets = facets_by_part(image, problems.restraints, cases, options.parts);
  PartPatches patches;
  std::optional<BodyForces> forces;
  std::optional<PartsOfImage> of_image;
  std::optional<SolidParts> solid;
  CellEigenvalues eigenvalues{};
  std::array<float, 2> ratios{};
  Dilatation dilatation = Dilatation::local;
  for (std::size_t l = 0; l < cells.size(); ++l) {
    const Triple& n = cells[l];
    const Vec<3> edges = lengths.cwiseQuotient(Vec<3>(n[0], n[1], n[2]));
    const auto ratio = l > 0 ? halvings(cells[l - 1], n) : std::nullopt;
    PartLayers layers = [&](Index begin, Index end) { return solid->layers(begin, end); };
    if (ratio) {
      const CellGrid& finer = problems.grids.back()->grid;
      layers = halved([&](Index begin, Index end) { return finer.layers(begin, end); }, cells[l - 1], *ratio);
      forces->coarsen(*ratio);
    } else {
      of_image.emplace(image, stiffness, n, 0.0);
      solid.emplace(image, stiffness, *of_image, n);
      forces.emplace(image, cases, n);
    }
    CellGrid grid(n, edges / unit_length, stabilised(layers, n), of_image->exact(), stiffness.anisotropy());
    if (l == 0) {
      ratios = grid.parts.ratios();
      dilatation = grid.needed();
    }
    if (!ratio || (*ratio)[0] != (*ratio)[1] || (*ratio)[1] != (*ratio)[2])
      eigenvalues = largest_eigenvalues(edges / unit_length, ratios);
    if (options.half_voxel && l == std::min<std::size_t>(1, cells.size() - 1)) {
      const PartsOfImage less(image, stiffness, n, -0.5);
      const PartLayers layers_of_less = [&](Index begin, Index end) { return less.layers(begin, end); };
      problems.shrunk.emplace(n, edges / unit_length, stabilised(layers_of_less, n), less.exact(),
                              stiffness.anisotropy());
    }
    CellProblem& problem = *problems.grids.emplace_back(std::make_unique<CellProblem>(
        std::move(grid), image.origin, edges, image.axes, dilatation, problems.restraints));
    if (ratio) {
      for (auto& [name, part] : patches) part = coarsened(part, *ratio);
    } else {
      const std::vector<float> parts = std::move(*solid).take();
      for (const auto& [name, part] : facets) patches[name] = boundary_patches(image, part, parts, n);
      solid.reset();
    }
    problem.springs = make_springs(problem, patches, problems.unit);
    std::vector<float> diagonal = problem.grid.bound(eigenvalues);
    problem.springs.add_bound(diagonal.data());
    problem.set_diagonal(std::move(diagonal));
    hold_nodes(problem, patches, l == 0);
    auto applied = set_loads(problem, cases, patches, *forces, problems.unit);
    const BodiesOnGrid bodies = examine_bodies(problem, image, l == 0, options.held);
    if (l > 0) {
      if (!ratio) raise_soft_diagonal(problem, *problems.grids[l - 1]);
      if (bodies.free_motions > problems.bodies.free_motions) add_weak_springs(problem);
      continue;
    }
    problems.applied = std::move(applied);
    problems.bodies = bodies;
  }
  return problems;
}

}  // namespace internal
}  // namespace efree
