// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/solvers/cells/effective.hpp"

#include "efree/core/error.hpp"
#include "efree/core/internal/clock.hpp"
#include "efree/core/memory.hpp"
#include "efree/geometry/input/box_averages.hpp"
#include "efree/solvers/cells/internal/frame_grids.hpp"
#include "efree/solvers/cells/internal/grid_iterations.hpp"

#include <fmt/format.h>
#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>
#include <optional>

namespace efree {
namespace {

using internal::CellAverages, internal::CellOperator, internal::ExactStiffness, internal::FrameGrid,
    internal::GridLevel, internal::Iterated, internal::LabelStiffness, internal::Multigrid, internal::Parts,
    internal::ReferenceEnergy, internal::Stopwatch;
using internal::Field, internal::for_all, internal::zeros, internal::dot;
using CellCounts = std::array<Index, 3>;

/// Part of the mean stiffness below which that of a load counts as none.
constexpr double no_stiffness = 1e-7;

/// What differs between elasticity and conduction: matrices of grids, one after the other from fine to coarse.
struct Physics {
  int components;
  double unit;  ///< of the tensor
  std::function<std::unique_ptr<CellOperator>(const CellCounts& cells, const Vec<3>& edges,
                                              const std::array<bool, 3>& flat)>
      matrix;
};

double nodes_of(const CellCounts& cells) {
  return (cells[0] + 1.0) * (cells[1] + 1.0) * (cells[2] + 1.0);
}
double cells_of(const CellCounts& cells) {
  return 1.0 * cells[0] * cells[1] * cells[2];
}
/// Of how much of an anisotropic material is in a cell's parts.
constexpr double bytes_of_share = 36.0;
/// Memory to a node for so many loads [bytes].
double memory_of_node(int components, int loads) {
  return 1.15 * (128.0 + 52.0 * components + 8.0 * components * loads);
}

/// Cells of the finest grid, which takes `besides` of a node [bytes].
CellCounts finest_cells(const LabelImage<3>& image, const EffectiveOptions& options, int components, int loads,
                        double besides) {
  constexpr double few = 300000.0;  // cells, up to which voxels are halved
  const bool is_periodic = options.frame == FrameCondition::periodic;
  const double per_node = memory_of_node(components, loads) + besides;
  const auto refined = [&](int by) {
    CellCounts cells = image.size;
    for (Index& n : cells)
      if (n > 1 || !is_periodic) n *= by;  // nothing depends on the place across one layer that repeats itself
    return cells;
  };
  const auto coarsened = [&](Index by) {
    CellCounts cells = image.size;
    for (Index& n : cells) n = (n + by - 1) / by;
    return cells;
  };
  if (options.size > 0.0) {
    CellCounts cells;
    for (int d = 0; d < 3; ++d) {
      const double voxels = options.size / image.spacing[d];
      const double wanted = voxels < 1.0 ? image.size[d] * std::ceil(1.0 / voxels - 1e-9)
                                         : std::ceil(image.size[d] / std::floor(voxels + 1e-9));
      cells[d] = static_cast<Index>(std::min(wanted, 1e6));
    }
    require_memory(per_node * nodes_of(cells),
                   fmt::format("a grid of {} x {} x {} cells", cells[0], cells[1], cells[2]),
                   "use larger cells (mesh_size)");
    return cells;
  }
  // Smooth boundaries are planes within halves of voxels: finer cells see these as mixtures.
  for (const int by : {4, 2})
    if ((by == 2 || !options.smooth) && cells_of(refined(by)) < few) return refined(by);
  Index by = 1;
  while (per_node * nodes_of(coarsened(by)) > 0.8 * available_memory() && cells_of(coarsened(by)) > few) ++by;
  return coarsened(by);
}

/// Cells of the grids, from fine to coarse: axes with the smallest edges are halved, odd numbers rounded up, until the
/// last grid is small enough for a dense inverse.
std::vector<CellCounts> frame_cells(const CellCounts& finest, const Vec<3>& lengths, FrameCondition frame) {
  constexpr double small = 150.0;  // nodes
  const Index least = frame == FrameCondition::periodic ? 1 : 2;
  std::vector<CellCounts> all{finest};
  while (all.size() < 3 || nodes_of(all.back()) > small) {  // three tell the error
    CellCounts cells = all.back();
    double smallest = std::numeric_limits<double>::max();
    for (int d = 0; d < 3; ++d)
      if (cells[d] > least) smallest = std::min(smallest, lengths[d] / cells[d]);
    bool any = false;
    for (int d = 0; d < 3; ++d)
      if (cells[d] > least && lengths[d] / cells[d] < 1.5 * smallest) {
        cells[d] = (cells[d] + 1) / 2;
        any = true;
      }
    if (!any) break;
    all.push_back(cells);
  }
  return all;
}

/// Forces at the nodes of a traction S n (a flux S . n) on the frame, for S with a unit component.
Field frame_load(const CellOperator& matrix, Index component) {
  static constexpr std::array<std::array<int, 2>, 6> pairs{{{0, 0}, {1, 1}, {2, 2}, {1, 2}, {0, 2}, {0, 1}}};
  const auto& grid = matrix.layout();
  Field load = zeros<double>(matrix.size());
  const auto add = [&](int c, int normal) {
    const int first = normal == 0 ? 1 : 0, second = normal == 2 ? 1 : 2;
    CellCounts at{};
    for (at[second] = 0; at[second] <= grid.cells[second]; ++at[second])
      for (at[first] = 0; at[first] <= grid.cells[first]; ++at[first]) {
        double area = grid.edges[first] * grid.edges[second];
        for (const int d : {first, second})
          if (at[d] == 0 || at[d] == grid.cells[d]) area *= 0.5;
        for (const bool upper : {false, true}) {
          at[normal] = upper ? grid.cells[normal] : 0;
          load[c * grid.nodes() + grid.node(at[0], at[1], at[2])] += upper ? area : -area;
        }
      }
  };
  if (matrix.components() == 1) {
    add(0, static_cast<int>(component));
  } else {
    const auto [a, b] = pairs[component];
    add(a, b);
    if (a != b) add(b, a);
  }
  return load;
}

/// Void next to the frame bears no traction.
void require_solid_frame(const FrameGrid& grid) {
  const auto& n = grid.layout().cells;
  for (Index k = 0; k <= n[2]; ++k)
    for (Index j = 0; j <= n[1]; ++j)
      for (Index i = 0; i <= n[0]; ++i)
        if ((i % n[0] == 0 || j % n[1] == 0 || k % n[2] == 0) && !grid.is_free(grid.layout().node(i, j, k)))
          throw InputError(
              "void reaches the frame of the image, which then cannot bear uniform tractions: take periodic or "
              "kinematic conditions");
}

Matrix inverted(const Matrix& symmetric) {
  return symmetric.ldlt().solve(Matrix(Matrix::Identity(symmetric.rows(), symmetric.cols())));
}

/// Frobenius norm of a tensor of elasticity in Kelvin's notation; of a conductivity, that of its matrix.
double kelvin_norm(const Matrix& tensor) {
  Matrix scaled = tensor;
  if (tensor.rows() == 6) {
    scaled.bottomRows<3>() *= std::sqrt(2.0);
    scaled.rightCols<3>() *= std::sqrt(2.0);
  }
  return scaled.norm();
}

/// How much coarser a grid is, along the axes where the finer one has more than a cell.
double coarsening(const CellCounts& fine, const CellCounts& coarse) {
  double product = 1.0;
  int axes = 0;
  for (int d = 0; d < 3; ++d) {
    product *= static_cast<double>(fine[d]) / coarse[d];
    axes += fine[d] > 1;
  }
  return std::pow(product, 1.0 / std::max(axes, 1));
}

/// Of the iterations on a grid, from what the coarser ones found, and it itself if that is known.
double tolerance_for(const std::vector<EffectiveLevel>& coarser, const Matrix* itself) {
  constexpr double least = 5e-5, most = 3e-3, share = 0.05;
  if (coarser.size() < (itself == nullptr ? 2 : 1)) return itself == nullptr ? 2.0 * least : least;
  const Matrix &finer = itself == nullptr ? coarser[0].tensor : *itself,
               &before = itself == nullptr ? coarser[1].tensor : coarser[0].tensor;
  const double size = kelvin_norm(finer), change = kelvin_norm(finer - before);
  return size > 0.0 ? std::clamp(share * std::sqrt(change / size), least, most) : least;
}

EffectiveTensor effective_tensor(const LabelImage<3>& image, const Physics& physics, const EffectiveOptions& options,
                                 const std::vector<CellCounts>& cells, const Stage& stage) {
  const bool is_uniform = options.frame == FrameCondition::uniform,
             is_periodic = options.frame == FrameCondition::periodic;
  const int strains = physics.components == 3 ? 6 : 3,
            loads = options.loads > 0 ? std::min(options.loads, strains) : strains;
  Vec<3> lengths;
  for (int d = 0; d < 3; ++d) lengths[d] = image.size[d] * image.spacing[d];
  const double unit_length = lengths.cwiseQuotient(Vec<3>(cells[0][0], cells[0][1], cells[0][2])).maxCoeff();
  std::vector<FrameGrid> grids;
  for (const CellCounts& n : cells) {
    stage.check();
    std::array<bool, 3> flat;
    for (int d = 0; d < 3; ++d) flat[d] = is_periodic && n[d] == 1;
    grids.emplace_back(physics.matrix(n, lengths.cwiseQuotient(Vec<3>(n[0], n[1], n[2])) / unit_length, flat),
                       options.frame);
  }
  for (std::size_t l = 1; l < grids.size(); ++l)
    if (!internal::halvings(cells[l - 1], cells[l])) internal::raise_soft_diagonal(grids[l], grids[l - 1]);
  if (is_uniform) require_solid_frame(grids[0]);
  std::vector<const GridLevel*> levels;
  for (const FrameGrid& grid : grids) levels.push_back(&grid);
  Multigrid precondition(levels, inverse_of(grids.back()));
  EffectiveTensor result;
  std::vector<Field> u(loads);
  const Matrix applied = Matrix::Identity(strains, loads), none = Matrix::Zero(strains, loads);
  for (std::size_t l = grids.size(); l-- > 0;) {
    const Stopwatch seconds;
    const FrameGrid& grid = grids[l];
    for (Field& of_load : u) {
      of_load = of_load.empty() ? zeros<double>(grid.size()) : precondition.prolonged(l, of_load);
      grid.complete(of_load.data());
    }
    std::vector<Field> tractions(is_uniform ? loads : 0);
    const double volume = grid.layout().edges.prod() * cells[l][0] * cells[l][1] * cells[l][2];
    EffectiveLevel found{.edges = grid.layout().edges * unit_length, .cells = cells[l][0] * cells[l][1] * cells[l][2]};
    Matrix mean = Matrix::Zero(strains, strains);
    Matrix stresses;
    const auto solve = [&](double to) {
      result.iteration_error = 0.0;
      for (int load = 0; load < loads; ++load) {
        Field f;
        const Vector stress = grid.matrix().apply_strain(applied.col(load), f);
        mean.col(load) = physics.unit / volume * stress;
        // Of the tractions' work, or of the mean strain less what fluctuations relieve.
        ReferenceEnergy energy{.of_work = 2.0, .of_own = -1.0};
        if (is_uniform) {
          f = frame_load(grid.matrix(), load);
        } else {
          grid.collect(f.data());
          for_all(f.size(), [&](std::size_t i) { f[i] = -f[i]; });
          energy = {.given = stress[load], .of_work = -2.0, .of_own = 1.0, .least = no_stiffness * stress[load]};
        }
        const Iterated iterated =
            iterate(grid, l, f, precondition, energy, {.tolerance = to, .most = options.most}, stage, u[load]);
        found.iterations = std::max(found.iterations, iterated.iterations);
        result.iteration_error = std::max(result.iteration_error, iterated.error * iterated.error);
        if (is_uniform) tractions[load] = std::move(f);
      }
      const CellAverages means = grid.matrix().averages(u, is_uniform ? none : applied);
      Matrix tensor = means.energy;
      stresses = means.stress.topRows(loads);
      if (is_uniform) {
        // Compliance from the mean strains, which the tractions' work tells; errors are of second order.
        Matrix strain(loads, loads);
        for (int a = 0; a < loads; ++a)
          for (int b = 0; b < loads; ++b) strain(a, b) = dot(tractions[a], u[b]) / volume;
        tensor = inverted(strain + strain.transpose() - means.energy);
        stresses = strain;
      }
      tensor = Matrix(physics.unit * 0.5 * (tensor + tensor.transpose()));
      if (!tensor.allFinite()) throw NumericalError("the effective tensor is not finite");
      return tensor;
    };
    const bool is_open = options.tolerance == 0.0;
    double tolerance = is_open ? 0.5 * tolerance_for(result.levels, nullptr) : options.tolerance;
    Matrix tensor = solve(tolerance);
    // Where this grid changes far less than the one before did, it is exact, and so should be the tensor.
    while (is_open && loads == strains && tolerance_for(result.levels, &tensor) < 0.3 * tolerance) {
      tolerance = tolerance_for(result.levels, &tensor);
      tensor = solve(tolerance);
    }
    found.tensor = Matrix::Zero(strains, strains);
    found.tensor.topLeftCorner(loads, loads) = tensor;
    found.seconds = seconds();
    result.levels.insert(result.levels.begin(), found);
    result.mean = mean;
    if (l == 0 && stresses.norm() > 0.0) result.asymmetry = (stresses - stresses.transpose()).norm() / stresses.norm();
    stage.tick(std::pow(8.0, -static_cast<double>(l)));
  }
  result.tensor = result.levels.front().tensor;
  const bool is_mixed = (result.finest().edges - image.spacing).maxCoeff() > 1e-9 * image.spacing.maxCoeff();
  const auto of_levels = [&](std::size_t a, std::size_t b) { return coarsening(cells[a], cells[b]); };
  estimate_grid_error(result, kelvin_norm, of_levels, is_mixed,
                      options.smooth ? 1.0 : 0.5);  // corners of voxels: less than one
  return result;
}

void check_effective(const LabelImage<3>& image, const EffectiveOptions& options) {
  check_image(image);
  if (!(options.size >= 0.0)) throw InputError(fmt::format("the size of cells is {}, expected > 0", options.size));
}

/// Means over boxes as box_averages has them, of voxels as they are.
std::vector<float> voxel_averages(const LabelImage<3>& image, const std::vector<float>& value_of_label,
                                  const CellCounts& boxes) {
  using Share = std::pair<Index, double>;
  std::array<std::vector<std::vector<Share>>, 3> shares;  // by axis and box: voxels, and their parts of it
  for (int d = 0; d < 3; ++d)
    for (Index box = 0; box < boxes[d]; ++box) {
      const double length = static_cast<double>(image.size[d]) / boxes[d], low = box * length, high = low + length;
      auto& of_box = shares[d].emplace_back();
      for (auto v = static_cast<Index>(low); v < image.size[d] && v < high; ++v) {
        const double share = (std::min(high, v + 1.0) - std::max<double>(low, v)) / length;
        if (share > 1e-9) of_box.emplace_back(v, share);
      }
    }
  std::vector<float> means(static_cast<std::size_t>(boxes[0]) * boxes[1] * boxes[2]);
  parallel_chunks(boxes[2], 1, [&](Index k, Index) {
    for (Index j = 0; j < boxes[1]; ++j)
      for (Index i = 0; i < boxes[0]; ++i) {
        double sum = 0.0;
        for (const auto& [z, of_z] : shares[2][k])
          for (const auto& [y, of_y] : shares[1][j])
            for (const auto& [x, of_x] : shares[0][i]) {
              const Label label = image.at({x, y, z});
              if (label < value_of_label.size()) sum += of_z * of_y * of_x * value_of_label[label];
            }
        means[i + static_cast<std::size_t>(boxes[0]) * (j + static_cast<std::size_t>(boxes[1]) * k)] =
            static_cast<float>(sum);
      }
  });
  return means;
}

/// An image with so many more voxels on each side, as it goes on periodically.
LabelImage<3> continued(const LabelImage<3>& image, Index by) {
  LabelImage<3> result;
  result.spacing = image.spacing;
  result.origin = image.origin - static_cast<double>(by) * image.spacing;
  for (int d = 0; d < 3; ++d) result.size[d] = image.size[d] + 2 * by;
  const auto wrapped = [&](Index i, int d) { return ((i - by) % image.size[d] + image.size[d]) % image.size[d]; };
  for (Index k = 0; k < result.size[2]; ++k)
    for (Index j = 0; j < result.size[1]; ++j)
      for (Index i = 0; i < result.size[0]; ++i) {
        const std::size_t from = image.index({wrapped(i, 0), wrapped(j, 1), wrapped(k, 2)});
        result.labels.push_back(image.labels[from]);
        if (!image.grey.empty()) result.grey.push_back(image.grey[from]);
      }
  return result;
}

/// Values by part of a grid over the frame, without those of a margin of so many parts on each side.
std::vector<float> without_margin(const std::vector<float>& parts, const CellCounts& size, const CellCounts& margin) {
  const CellCounts all{size[0] + 2 * margin[0], size[1] + 2 * margin[1], size[2] + 2 * margin[2]};
  std::vector<float> result;
  result.reserve(static_cast<std::size_t>(size[0]) * size[1] * size[2]);
  for (Index k = 0; k < size[2]; ++k)
    for (Index j = 0; j < size[1]; ++j) {
      const auto row =
          parts.begin() + margin[0] +
          static_cast<std::ptrdiff_t>(all[0]) * (margin[1] + j + static_cast<std::ptrdiff_t>(all[1]) * (margin[2] + k));
      result.insert(result.end(), row, row + size[0]);
    }
  return result;
}

/// Calls average(image, cells), which sets values by part of cells, for the grid of an image. Boundaries inside voxels,
/// which depend on voxels around, are those of the image as it goes on periodically where that can be done and
/// `goes_on`.
template <class Average> void average_parts(const LabelImage<3>& image, const CellCounts& cells, bool goes_on,
                                            const Average& average, const std::vector<std::vector<float>*>& parts) {
  constexpr Index around = 2;  // voxels that a boundary depends on
  bool fits = goes_on;
  for (int d = 0; d < 3; ++d) fits = fits && cells[d] % image.size[d] == 0;
  if (!fits) {
    average(image, cells);
    return;
  }
  CellCounts size, margin, all;
  for (int d = 0; d < 3; ++d) {
    const Index to_voxel = cells[d] / image.size[d];
    size[d] = 2 * cells[d];
    margin[d] = 2 * to_voxel * around;
    all[d] = cells[d] + 2 * to_voxel * around;
  }
  average(continued(image, around), all);
  for (std::vector<float>* values : parts) *values = without_margin(*values, size, margin);
}

/// The rate p between `slowest` and 2 at which differences of three grids, each so many times as coarse as the one
/// before, fall by `quotient`: that of (ab)^p - a^p to a^p - 1.
double rate_of(double quotient, double a, double b, double slowest) {
  double low = slowest, high = 2.0;
  while (high - low > 1e-3) {
    const double p = 0.5 * (low + high), falls = std::pow(a, p) * (std::pow(b, p) - 1.0) / (std::pow(a, p) - 1.0);
    (falls < quotient ? low : high) = p;
  }
  return 0.5 * (low + high);
}

/// Takes off what the grid leaves, unless it is so much of a modulus that grids are not on their way to anything.
void extrapolate(const Matrix& left, EffectiveTensor& result) {
  constexpr double most = 0.25;
  const auto left_of_modulus = left.diagonal().cwiseAbs().array();
  if ((left_of_modulus <= most * result.tensor.diagonal().array()).all()) result.extrapolated -= left;
}

}  // namespace

void estimate_grid_error(EffectiveTensor& result, const std::function<double(const Matrix&)>& norm,
                         const std::function<double(std::size_t, std::size_t)>& coarsening, bool is_mixed,
                         double slowest) {
  result.extrapolated = result.tensor;
  std::vector<std::size_t> chosen{0};
  for (std::size_t l = 1; l < result.levels.size() && chosen.size() < 3; ++l)
    if (coarsening(chosen.back(), l) > 1.6) chosen.push_back(l);
  const double size = norm(result.tensor);
  if (chosen.size() < 2 || size == 0.0) return;
  const Matrix last = result.levels[chosen[1]].tensor - result.tensor;
  const double now = norm(last), ratio = coarsening(0, chosen[1]);
  double rate = 1.0, before = now;
  if (chosen.size() > 2) {
    before = norm(result.levels[chosen[2]].tensor - result.levels[chosen[1]].tensor);
    if (now > 0.0) rate = rate_of(before / now, ratio, coarsening(chosen[1], chosen[2]), slowest);
  }
  const double share = 1.0 / (std::pow(ratio, rate) - 1.0);
  result.grid_error = share * now / size;
  if (is_mixed)
    result.grid_error = std::max(result.grid_error, 0.5 * before / size);  // as if at first order
  else
    extrapolate(share * last, result);
}

EffectiveTensor effective_stiffness(const LabelImage<3>& image, const std::vector<SharedMaterial>& materials,
                                    const EffectiveOptions& options, const Monitor& monitor) {
  check_effective(image, options);
  const Stage stage("solve", monitor);
  LabelStiffness stiffness(image, materials);
  const CellCounts finest =
      finest_cells(image, options, 3, 6, bytes_of_share * static_cast<double>(stiffness.anisotropy().size()));
  Vec<3> lengths;
  for (int d = 0; d < 3; ++d) lengths[d] = image.size[d] * image.spacing[d];
  const std::vector<CellCounts> cells = frame_cells(finest, lengths, options.frame);
  ExactStiffness exact;
  for (std::size_t label = 0; label < stiffness.shear.size(); ++label)
    if (stiffness.shear[label] > 0.0F) {
      exact.rounded.push_back({stiffness.shear[label], stiffness.across[label]});
      exact.exact.push_back({stiffness.exact_shear[label], stiffness.exact_across[label]});
    }
  for (const internal::AnisotropicLabels& of : stiffness.anisotropic) {
    exact.rounded.push_back({static_cast<float>(of.isotropic.shear), static_cast<float>(of.isotropic.across)});
    exact.exact.push_back({of.isotropic.shear, of.isotropic.across});
  }
  const std::vector<VoigtMatrix<3>> anisotropy = stiffness.anisotropy();
  Parts parts;
  parts.shares.resize(anisotropy.size());
  std::vector<std::vector<float>*> values{&parts.shear, &parts.across};
  for (std::vector<float>& share : parts.shares) values.push_back(&share);
  CellCounts before{};
  const auto matrix = [&](const CellCounts& n, const Vec<3>& edges, const std::array<bool, 3>& flat) {
    const auto ratio = before[0] > 0 ? internal::halvings(before, n) : std::nullopt;
    if (ratio) {
      for (std::vector<float>* of : values) *of = internal::halved(*of, before, *ratio);
    } else if (!options.smooth && !stiffness.varies()) {
      const CellCounts boxes{2 * n[0], 2 * n[1], 2 * n[2]};
      parts.shear = voxel_averages(image, stiffness.shear, boxes);
      parts.across = voxel_averages(image, stiffness.across, boxes);
      for (std::size_t m = 0; m < parts.shares.size(); ++m)
        parts.shares[m] = voxel_averages(image, internal::ones_of(stiffness.anisotropic[m].labels), boxes);
      internal::add_isotropic_parts(stiffness.anisotropic, parts);
    } else {
      average_parts(
          image, n,
          // Expressions of the place mean nothing outside of the frame.
          options.frame == FrameCondition::periodic && !stiffness.varies(),
          [&](const LabelImage<3>& of, const CellCounts& by) {
            Parts found = internal::PartsOfImage(of, stiffness, by, 0.0).layers(0, by[2]);
            parts.shear = std::move(found.shear);
            parts.across = std::move(found.across);
            std::ranges::move(found.shares, parts.shares.begin());
          },
          values);
    }
    before = n;
    return internal::elastic_operator(n, edges, flat, internal::layers_of(parts, n), exact, anisotropy);
  };
  return effective_tensor(image, {3, stiffness.unit, matrix}, options, cells, stage);
}

EffectiveTensor effective_conductivity(const LabelImage<3>& image, const std::vector<double>& conductivities,
                                       const EffectiveOptions& options, const Monitor& monitor) {
  check_effective(image, options);
  const Stage stage("solve", monitor);
  double unit = 0.0;
  for (const LabelCount& count : count_labels(image)) {
    if (count.label == 0) continue;
    if (count.label >= conductivities.size())
      throw InputError(fmt::format("the image has the label {}, which has no conductivity", count.label));
    const double k = conductivities[count.label];
    if (!(k >= 0.0) || !std::isfinite(k))
      throw InputError(fmt::format("the conductivity of label {} is {}, expected a number >= 0", count.label, k));
    unit = std::max(unit, k);
  }
  if (unit == 0.0) throw InputError("nothing in the image conducts");
  std::vector<float> scaled(conductivities.size(), 0.0F);
  ExactStiffness exact;
  for (std::size_t label = 1; label < scaled.size(); ++label) {
    const double k = conductivities[label] / unit;
    if (!(k > 0.0) || !std::isfinite(k)) continue;
    scaled[label] = static_cast<float>(k);
    exact.rounded.push_back({scaled[label], 0.0F});
    exact.exact.push_back({k, 0.0});
  }
  const CellCounts finest = finest_cells(image, options, 1, 3, 0.0);
  Vec<3> lengths;
  for (int d = 0; d < 3; ++d) lengths[d] = image.size[d] * image.spacing[d];
  const std::vector<CellCounts> cells = frame_cells(finest, lengths, options.frame);
  Parts parts;
  CellCounts before{};
  const auto matrix = [&](const CellCounts& n, const Vec<3>& edges, const std::array<bool, 3>& flat) {
    const auto ratio = before[0] > 0 ? internal::halvings(before, n) : std::nullopt;
    if (ratio)
      parts.shear = internal::halved(parts.shear, before, *ratio);
    else if (!options.smooth)
      parts.shear = voxel_averages(image, scaled, {2 * n[0], 2 * n[1], 2 * n[2]});
    else
      average_parts(image, n, options.frame == FrameCondition::periodic,
                    [&](const LabelImage<3>& of, const CellCounts& by) {
                      parts.shear = box_averages(of, scaled, {2 * by[0], 2 * by[1], 2 * by[2]});
                    },
                    {&parts.shear});
    before = n;
    return internal::conduction_operator(n, edges, flat, internal::layers_of(parts, n), exact);
  };
  return effective_tensor(image, {1, unit, matrix}, options, cells, stage);
}

}  // namespace efree
