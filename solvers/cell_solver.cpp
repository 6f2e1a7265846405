// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/solvers/cell_solver.hpp"

#include "efree/core/error.hpp"
#include "efree/core/memory.hpp"
#include "efree/core/parallel.hpp"
#include "efree/geometry/box_averages.hpp"
#include "efree/solvers/cholesky.hpp"
#include "efree/solvers/internal/cell_grid.hpp"

#include <fmt/format.h>
#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <limits>
#include <memory>
#include <numeric>
#include <optional>
#include <string_view>

namespace efree {
namespace {

using internal::CellGrid, internal::CellEigenvalues;
/// Memory is first written by those who fill it, in parallel: pages are handed out then.
template <class T> struct Uninitialised : std::allocator<T> {
  template <class U> struct rebind { using other = Uninitialised<U>; };
  template <class U, class... Values> void construct(U* at, Values&&... values) {
    if constexpr (sizeof...(Values) == 0)
      ::new (static_cast<void*>(at)) U;
    else
      ::new (static_cast<void*>(at)) U(std::forward<Values>(values)...);
  }
};
template <class T> using Values = std::vector<T, Uninitialised<T>>;
using Field = Values<double>;
using SingleField = Values<float>;

/// A side of the image's frame.
struct Side {
  int axis;
  bool upper;
};
constexpr std::array<std::string_view, 6> sides{"left", "right", "front", "back", "bottom", "top"};
Side side_named(const std::string& name) {
  const auto found = std::ranges::find(sides, name);
  if (found == sides.end())
    throw InputError(
        fmt::format("on cells conditions and loads are on sides of the image (left, right, front, back, bottom, top), "
                    "not on \"{}\"",
                    name));
  const auto s = static_cast<int>(found - sides.begin());
  return {s / 2, s % 2 == 1};
}

/// A displacement component that is prescribed on a side.
struct Held {
  Side side;
  int component;
  ScalarField<3> value;
};
std::vector<Held> held_components(const std::vector<DisplacementCondition<3>>& conditions) {
  std::vector<Held> held;
  for (const auto& condition : conditions) {
    const Side side = side_named(condition.on);
    for (int c = 0; c < 3; ++c)
      if (condition.components[c]) held.push_back({side, c, condition.components[c]});
    if (condition.normal)
      held.push_back({side, side.axis, [value = condition.normal, sign = side.upper ? 1.0 : -1.0](const Vec<3>& x) {
                        return sign * value(x);
                      }});
  }
  return held;
}

/// The elastic problem on one grid.
struct Problem {
  CellGrid grid;
  Vec<3> origin;
  const std::vector<Held>& held;
  std::vector<float> inverse_diagonal;  ///< of a diagonal that is nowhere less than K; 0 where nothing is free
  Field load;                           ///< empty without tractions

  Index nodes(int axis) const { return grid.cells[axis] + 1; }
  Vec<3> place(Index i, Index j, Index k) const { return origin + grid.edges.cwiseProduct(Vec<3>(i, j, k)); }

  /// Calls f(i, j, k) for the nodes of a side.
  template <class F> void on_side(const Side& side, const F& f) const {
    const int first = side.axis == 0 ? 1 : 0, second = side.axis == 2 ? 1 : 2;
    std::array<Index, 3> at{};
    at[side.axis] = side.upper ? grid.cells[side.axis] : 0;
    for (at[second] = 0; at[second] < nodes(second); ++at[second])
      for (at[first] = 0; at[first] < nodes(first); ++at[first]) f(at[0], at[1], at[2]);
  }
  void clear_held(std::vector<float>& field) const {
    for (const Held& h : held)
      on_side(h.side,
              [&](Index i, Index j, Index k) { field[h.component * grid.nodes() + grid.node(i, j, k)] = 0.0F; });
  }
  void set_held(Field& u) const {
    for (const Held& h : held)
      on_side(h.side, [&](Index i, Index j, Index k) {
        u[h.component * grid.nodes() + grid.node(i, j, k)] = h.value(place(i, j, k));
      });
  }
  Index num_cells() const {
    std::vector<Index> of_layer(grid.cells[2], 0);
    parallel_chunks(grid.cells[2], 4, [&](Index begin, Index end) {
      for (Index k = begin; k < end; ++k)
        for (Index j = 0; j < grid.cells[1]; ++j)
          for (Index i = 0; i < grid.cells[0]; ++i) {
            bool some = false;
            for (int q = 0; q < 8; ++q) some = some || grid.weight(i, j, k, q) > 0.0F;
            of_layer[k] += some;
          }
    });
    return std::accumulate(of_layer.begin(), of_layer.end(), Index(0));
  }
};

constexpr Index chunk = 1 << 14;

/// Sum over i of f(i); the same on any number of threads.
template <class F> double summed(std::size_t size, const F& f) {
  const Index chunks = static_cast<Index>((size + chunk - 1) / chunk);
  std::vector<double> part(chunks);
  parallel_chunks(chunks, 1, [&](Index begin, Index end) {
    for (Index c = begin; c < end; ++c) {
      const std::size_t first = static_cast<std::size_t>(c) * chunk, last = std::min(size, first + chunk);
      double sum = 0.0;
      for (std::size_t i = first; i < last; ++i) sum += f(i);
      part[c] = sum;
    }
  });
  double sum = 0.0;
  for (const double p : part) sum += p;
  return sum;
}
template <class F> void for_all(std::size_t size, const F& f) {
  parallel_chunks(static_cast<Index>((size + chunk - 1) / chunk), 1, [&](Index begin, Index end) {
    const std::size_t first = static_cast<std::size_t>(begin) * chunk,
                      last = std::min(size, static_cast<std::size_t>(end) * chunk);
    for (std::size_t i = first; i < last; ++i) f(i);
  });
}
template <class T> Values<T> zeros(std::size_t size) {
  Values<T> result(size);
  for_all(size, [&](std::size_t i) { result[i] = T(0); });
  return result;
}
template <class A, class B> double dot(const Values<A>& a, const Values<B>& b) {
  return summed(a.size(), [&](std::size_t i) { return static_cast<double>(a[i]) * b[i]; });
}

/// coarse = P^T fine with trilinear P.
void restrict_to(const Problem& coarse, const CellGrid& fine, const SingleField& from, SingleField& to) {
  const CellGrid& grid = coarse.grid;
  parallel_chunks(grid.cells[2] + 1, 2, [&](Index begin, Index end) {
    std::vector<float> line(fine.pitch + 1);
    for (int c = 0; c < 3; ++c)
      for (Index k = begin; k < end; ++k)
        for (Index j = 0; j <= grid.cells[1]; ++j) {
          std::ranges::fill(line, 0.0F);
          for (int dk = -1; dk <= 1; ++dk)
            for (int dj = -1; dj <= 1; ++dj) {
              const Index fj = 2 * j + dj, fk = 2 * k + dk;
              if (fj < 0 || fj > fine.cells[1] || fk < 0 || fk > fine.cells[2]) continue;
              const float weight = (dk ? 0.5F : 1.0F) * (dj ? 0.5F : 1.0F);
              const float* row = from.data() + c * fine.nodes() + fine.node(0, fj, fk);
              for (Index i = 0; i <= fine.cells[0]; ++i) line[i] += weight * row[i];
            }
          const std::size_t node = c * grid.nodes() + grid.node(0, j, k);
          for (Index i = 0; i <= grid.cells[0]; ++i) {
            float sum = line[2 * i];
            if (i > 0) sum += 0.5F * line[2 * i - 1];
            if (i < grid.cells[0]) sum += 0.5F * line[2 * i + 1];
            to[node + i] = coarse.inverse_diagonal[node + i] > 0.0F ? sum : 0.0F;
          }
        }
  });
}

/// fine += P coarse.
template <class T> void prolong(const CellGrid& coarse, const CellGrid& fine, const Values<T>& from, Values<T>& to) {
  parallel_chunks(fine.cells[2] + 1, 4, [&](Index begin, Index end) {
    std::vector<T> line(coarse.cells[0] + 1);
    for (int c = 0; c < 3; ++c)
      for (Index k = begin; k < end; ++k)
        for (Index j = 0; j <= fine.cells[1]; ++j) {
          const T* base = from.data() + c * coarse.nodes();
          const T* rows[4] = {base + coarse.node(0, j / 2, k / 2), base + coarse.node(0, (j + 1) / 2, k / 2),
                              base + coarse.node(0, j / 2, (k + 1) / 2),
                              base + coarse.node(0, (j + 1) / 2, (k + 1) / 2)};
          for (Index i = 0; i <= coarse.cells[0]; ++i)
            line[i] = T(0.25) * (rows[0][i] + rows[1][i] + rows[2][i] + rows[3][i]);
          T* out = to.data() + c * fine.nodes() + fine.node(0, j, k);
          for (Index i = 0; i <= coarse.cells[0]; ++i) {
            out[2 * i] += line[i];
            if (i < coarse.cells[0]) out[2 * i + 1] += T(0.5) * (line[i] + line[i + 1]);
          }
        }
  });
}

/// Throws InputError naming the place of a body that is loaded, but not held against the motion its loads ask for.
/// Bodies are cells with a point in common.
void require_held_where_loaded(const Problem& problem) {
  const CellGrid& grid = problem.grid;
  const auto& n = grid.cells;
  const auto index = [&](Index i, Index j, Index k) {
    return i + static_cast<std::size_t>(n[0]) * (j + static_cast<std::size_t>(n[1]) * k);
  };
  const auto for_cells = [&](const std::array<Index, 3>& low, const std::array<Index, 3>& high, const auto& f) {
    for (Index k = std::max(low[2], 0); k <= std::min(high[2], n[2] - 1); ++k)
      for (Index j = std::max(low[1], 0); j <= std::min(high[1], n[1] - 1); ++j)
        for (Index i = std::max(low[0], 0); i <= std::min(high[0], n[0] - 1); ++i) f(i, j, k);
  };
  std::vector<char> waiting(static_cast<std::size_t>(n[0]) * n[1] * n[2]), seen(grid.nodes(), 0);
  for_cells({0, 0, 0}, n, [&](Index i, Index j, Index k) {
    for (int q = 0; q < 8; ++q) waiting[index(i, j, k)] |= grid.weight(i, j, k, q) > 0.0F;
  });
  using Motion = Eigen::Matrix<double, 6, 1>;  // translations and rotations
  const Vec<3> middle = problem.place(n[0] / 2, n[1] / 2, n[2] / 2);
  const double length = grid.edges.cwiseProduct(Vec<3>(n[0], n[1], n[2])).norm();
  std::vector<std::array<Index, 3>> front;
  for_cells({0, 0, 0}, n, [&](Index i0, Index j0, Index k0) {
    if (!waiting[index(i0, j0, k0)]) return;
    Eigen::Matrix<double, 6, 6> held = Eigen::Matrix<double, 6, 6>::Zero();
    Motion load = Motion::Zero();
    double forces = 0.0;
    front.assign(1, {i0, j0, k0});
    waiting[index(i0, j0, k0)] = 0;
    while (!front.empty()) {
      const auto [i, j, k] = front.back();
      front.pop_back();
      for (int a = 0; a < 8; ++a) {
        const Index x = i + (a & 1), y = j + (a >> 1 & 1), z = k + (a >> 2);
        const std::size_t node = grid.node(x, y, z);
        if (seen[node]) continue;
        seen[node] = 1;
        const Vec<3> arm = (problem.place(x, y, z) - middle) / length;
        for (int c = 0; c < 3; ++c) {
          Motion motion = Motion::Zero();
          motion[c] = 1.0;
          motion.tail<3>() = arm.cross(Vec<3>::Unit(c));
          const std::size_t dof = c * grid.nodes() + node;
          if (problem.inverse_diagonal[dof] == 0.0F)
            held += motion * motion.transpose();
          else
            load += problem.load[dof] * motion;
          forces += std::abs(problem.load[dof]);
        }
      }
      for_cells({i - 1, j - 1, k - 1}, {i + 1, j + 1, k + 1}, [&](Index a, Index b, Index c) {
        if (!waiting[index(a, b, c)]) return;
        waiting[index(a, b, c)] = 0;
        front.push_back({a, b, c});
      });
    }
    const Eigen::SelfAdjointEigenSolver<Eigen::Matrix<double, 6, 6>> motions(held);
    for (int m = 0; m < 6; ++m)
      if (motions.eigenvalues()[m] < 1e-9 * std::max(1.0, held.trace()) &&
          std::abs(motions.eigenvectors().col(m).dot(load)) > 1e-6 * forces) {
        const Vec<3> at = problem.place(i0, j0, k0);
        throw InputError(fmt::format(
            "the body at ({:.6g}, {:.6g}, {:.6g}) is loaded, but free to move: prescribe displacements that "
            "hold it",
            at[0], at[1], at[2]));
      }
  });
}

/// Factor of the coarsest grid's matrix, held unknowns and those without stiffness left out.
class CoarsestSolver {
 public:
  explicit CoarsestSolver(const Problem& problem) {
    const CellGrid& grid = problem.grid;
    // Columns of nodes three apart do not overlap: 27 times three products have them all.
    Field u = zeros<double>(grid.size()), f(grid.size());
    unknown_.assign(grid.size(), -1);
    for_nodes(grid, [&](Index i, Index j, Index k) {
      for (int c = 0; c < 3; ++c) {
        const std::size_t dof = c * grid.nodes() + grid.node(i, j, k);
        if (problem.inverse_diagonal[dof] > 0.0F) {
          unknown_[dof] = static_cast<Index>(dofs_.size());
          dofs_.push_back(dof);
        }
      }
    });
    std::vector<Eigen::Triplet<double, Index>> entries;
    for (int colour = 0; colour < 81; ++colour) {
      const int c = colour / 27, x = colour % 3, y = colour / 3 % 3, z = colour / 9 % 3;
      std::ranges::fill(u, 0.0);
      for_nodes(grid, [&](Index i, Index j, Index k) {
        const std::size_t dof = c * grid.nodes() + grid.node(i, j, k);
        if (i % 3 == x && j % 3 == y && k % 3 == z && unknown_[dof] >= 0) u[dof] = 1.0;
      });
      grid.apply(u.data(), f.data());
      for_nodes(grid, [&](Index i, Index j, Index k) {
        // The one node of this colour among the neighbours.
        const Index a = i + (x - i % 3 + 4) % 3 - 1, b = j + (y - j % 3 + 4) % 3 - 1, d = k + (z - k % 3 + 4) % 3 - 1;
        if (a < 0 || b < 0 || d < 0 || a > grid.cells[0] || b > grid.cells[1] || d > grid.cells[2]) return;
        const Index column = unknown_[c * grid.nodes() + grid.node(a, b, d)];
        if (column < 0) return;
        for (int r = 0; r < 3; ++r) {
          const std::size_t dof = r * grid.nodes() + grid.node(i, j, k);
          const Index line = unknown_[dof];
          if (line < column) continue;
          // Bodies that nothing holds would make the matrix singular.
          entries.emplace_back(line, column, line == column ? f[dof] * (1.0 + 1e-7) : f[dof]);
        }
      });
    }
    SymmetricMatrix K(static_cast<Index>(dofs_.size()), static_cast<Index>(dofs_.size()));
    K.setFromTriplets(entries.begin(), entries.end());
    if (!dofs_.empty()) factor_.emplace(K);
  }
  template <class T> void solve(const Values<T>& b, Values<T>& x) const {
    std::ranges::fill(x, T(0));
    if (!factor_) return;
    Matrix right(dofs_.size(), 1);
    for (std::size_t i = 0; i < dofs_.size(); ++i) right(i, 0) = b[dofs_[i]];
    const Matrix answer = factor_->solve(right);
    for (std::size_t i = 0; i < dofs_.size(); ++i) x[dofs_[i]] = static_cast<T>(answer(i, 0));
  }

 private:
  template <class F> static void for_nodes(const CellGrid& grid, const F& f) {
    for (Index k = 0; k <= grid.cells[2]; ++k)
      for (Index j = 0; j <= grid.cells[1]; ++j)
        for (Index i = 0; i <= grid.cells[0]; ++i) f(i, j, k);
  }
  std::vector<Index> unknown_;
  std::vector<std::size_t> dofs_;
  std::optional<Cholesky> factor_;
};

/// A V-cycle over grids, in single precision.
class Multigrid {
 public:
  /// From `finest` of `problems` on, which are ordered from fine to coarse.
  Multigrid(const std::vector<std::unique_ptr<Problem>>& problems, const CoarsestSolver& coarsest)
      : problems_(problems), coarsest_(coarsest), work_(problems.size()) {
    for (std::size_t l = 0; l < problems.size(); ++l)
      for (auto* field : {&work_[l].b, &work_[l].x, &work_[l].step, &work_[l].rest})
        *field = zeros<float>(problems[l]->grid.size());
  }

  SingleField& right(std::size_t l) { return work_[l].b; }
  /// An approximate inverse of K times right(l).
  const SingleField& operator()(std::size_t l) {
    cycle(l);
    return work_[l].x;
  }

 private:
  struct Work {
    SingleField b, x, step, rest;
  };
  static constexpr int degree = 2;
  static constexpr double range = 8.0;  ///< part of the spectrum that the smoother works on

  /// x += a polynomial of b - K x; at first x is 0.
  void smooth(std::size_t l, bool at_first) {
    const Problem& problem = *problems_[l];
    Work& w = work_[l];
    constexpr double high = 1.0, low = high / range, centre = 0.5 * (high + low), half = 0.5 * (high - low);
    double rho = half / centre;
    for (int s = 0; s < degree; ++s) {
      float keep = 0.0F, take = static_cast<float>(1.0 / centre);
      if (s > 0) {
        const double next = 1.0 / (2.0 * centre / half - rho);
        keep = static_cast<float>(next * rho);
        take = static_cast<float>(2.0 * next / half);
        rho = next;
      }
      const float* inverse = problem.inverse_diagonal.data();
      if (at_first && s == 0) {
        for_all(w.b.size(), [&](std::size_t i) { w.x[i] = w.step[i] = take * inverse[i] * w.b[i]; });
        continue;
      }
      problem.grid.apply(w.x.data(), w.rest.data());
      if (s == 0)
        for_all(w.b.size(), [&](std::size_t i) {
          w.step[i] = take * inverse[i] * (w.b[i] - w.rest[i]);
          w.x[i] += w.step[i];
        });
      else
        for_all(w.b.size(), [&](std::size_t i) {
          w.step[i] = keep * w.step[i] + take * inverse[i] * (w.b[i] - w.rest[i]);
          w.x[i] += w.step[i];
        });
    }
  }

  void cycle(std::size_t l) {
    Work& w = work_[l];
    if (l + 1 == problems_.size()) {
      coarsest_.solve(w.b, w.x);
      return;
    }
    const Problem &fine = *problems_[l], &coarse = *problems_[l + 1];
    smooth(l, true);
    fine.grid.apply(w.x.data(), w.rest.data());
    for_all(w.b.size(),
            [&](std::size_t i) { w.rest[i] = fine.inverse_diagonal[i] > 0.0F ? w.b[i] - w.rest[i] : 0.0F; });
    restrict_to(coarse, fine.grid, w.rest, work_[l + 1].b);
    cycle(l + 1);
    prolong(coarse.grid, fine.grid, work_[l + 1].x, w.x);
    for_all(w.b.size(), [&](std::size_t i) { w.x[i] = fine.inverse_diagonal[i] > 0.0F ? w.x[i] : 0.0F; });
    smooth(l, false);
  }

  const std::vector<std::unique_ptr<Problem>>& problems_;
  const CoarsestSolver& coarsest_;
  std::vector<Work> work_;
};

/// What all of a are of b, if it is the same; void (0) left out of account.
std::optional<float> common_ratio(const std::vector<float>& a, const std::vector<float>& b) {
  std::optional<float> ratio;
  for (std::size_t i = 0; i < a.size(); ++i) {
    if (b[i] == 0.0F) continue;
    if (!ratio) ratio = a[i] / b[i];
    if (std::abs(a[i] - *ratio * b[i]) > 1e-6F * std::abs(a[i])) return {};
  }
  return ratio;
}

/// Cells along the axes for edges of about `size`, and how often they can be halved: grids down to one of at most some
/// thousand points, cells never longer than asked for. At least twice: three grids tell the error.
std::pair<std::array<Index, 3>, int> grid_sizes(const Vec<3>& lengths, double size) {
  constexpr double few = 2500.0;
  for (int halvings = 2;; ++halvings) {
    std::array<Index, 3> coarsest;
    double points = 1.0;
    for (int d = 0; d < 3; ++d) {
      const double wanted = lengths[d] / (size * std::pow(2.0, halvings));
      if (wanted > 1e6) break;
      coarsest[d] = std::max<Index>(1, static_cast<Index>(std::ceil(wanted - 1e-9)));
      points *= coarsest[d] + 1.0;
    }
    if (points > few) continue;
    for (Index& n : coarsest) n <<= halvings;
    return {coarsest, halvings};
  }
}

}  // namespace

bool is_side(const std::string& name) {
  return std::ranges::find(sides, name) != sides.end();
}

CellSolution solve_on_cells(const LabelImage<3>& image, const std::vector<LinearElastic>& materials,
                            const std::vector<DisplacementCondition<3>>& conditions, const Loads<3>& loads,
                            const CellOptions& options, StageTimes* times, const Progress& progress) {
  check_image(image);
  StageTimes own;
  StageTimes& clock = times ? *times : own;
  Vec<3> lengths;
  for (int d = 0; d < 3; ++d) lengths[d] = image.size[d] * image.spacing[d];
  const double size = options.size > 0.0 ? options.size : 2.0 * image.spacing.maxCoeff();
  if (!(options.size >= 0.0)) throw InputError(fmt::format("the size of cells is {}, expected > 0", options.size));
  if (loads.body_force) throw InputError("on cells there are no body forces");
  const auto [cells, halvings] = grid_sizes(lengths, size);
  const double points = (cells[0] + 12.0) * (cells[1] + 1.0) * (cells[2] + 1.0);
  require_memory(cell_memory * points, fmt::format("a grid of {} x {} x {} cells", cells[0], cells[1], cells[2]),
                 "use larger cells (mesh_size)");
  const std::vector<Held> held = held_components(conditions);

  std::vector<std::unique_ptr<Problem>> problems;
  std::optional<CoarsestSolver> coarsest;
  std::optional<CellGrid> shrunk;  // half a voxel less material, on the second grid, where that is cheap
  {
    const Stage stage("assembly", clock, progress);
    std::vector<float> mu_of(materials.size(), 0.0F), lambda_of = mu_of, solid = mu_of;
    float least_ratio = std::numeric_limits<float>::max(), most_ratio = std::numeric_limits<float>::lowest();
    for (const LabelCount& count : count_labels(image)) {
      if (count.label == 0) continue;
      if (count.label >= materials.size())
        throw InputError(fmt::format("the image has the label {}, which has no material", count.label));
      const Lame lame = solid_lame(materials[count.label]);
      least_ratio = std::min(least_ratio, static_cast<float>(lame.lambda / lame.mu));
      most_ratio = std::max(most_ratio, static_cast<float>(lame.lambda / lame.mu));
      mu_of[count.label] = static_cast<float>(lame.mu);
      lambda_of[count.label] = static_cast<float>(lame.lambda);
      solid[count.label] = 1.0F;
    }
    std::array<Index, 3> n = cells;
    const auto averages = [&](const std::vector<float>& of_label, const std::array<Index, 3>& grid, double outwards) {
      return box_averages(image, of_label, {2 * grid[0], 2 * grid[1], 2 * grid[2]}, outwards);
    };
    const auto ratio = common_ratio(lambda_of, mu_of);
    // Lame constants by part of a grid's cells.
    const auto moduli = [&](const std::array<Index, 3>& grid, double outwards) {
      std::pair<std::vector<float>, std::vector<float>> result{averages(mu_of, grid, outwards), {}};
      if (!ratio) {
        result.second = averages(lambda_of, grid, outwards);
      } else {
        result.second.resize(result.first.size());
        for_all(result.first.size(), [&](std::size_t i) { result.second[i] = *ratio * result.first[i]; });
      }
      return result;
    };
    auto [mu, lambda] = moduli(n, 0.0);
    const Vec<3> proportions = lengths.cwiseQuotient(Vec<3>(n[0], n[1], n[2]));
    const CellEigenvalues eigenvalues = internal::largest_eigenvalues(proportions, least_ratio, most_ratio);
    for (int level = 0;; ++level) {
      Vec<3> edges;
      for (int d = 0; d < 3; ++d) edges[d] = lengths[d] / n[d];
      if (options.half_voxel && level == std::min(1, halvings)) {
        const auto [less_mu, less_lambda] = moduli(n, -0.5);
        shrunk.emplace(n, edges, less_mu, less_lambda);
      }
      problems.push_back(
          std::make_unique<Problem>(Problem{CellGrid(n, edges, mu, lambda), image.origin, held, {}, {}}));
      Problem& problem = *problems.back();
      problem.inverse_diagonal = problem.grid.bound(eigenvalues);
      for_all(problem.inverse_diagonal.size(), [&](std::size_t i) {
        float& d = problem.inverse_diagonal[i];
        d = d > 0.0F ? 1.0F / d : 0.0F;
      });
      problem.clear_held(problem.inverse_diagonal);
      if (!loads.tractions.empty()) problem.load = zeros<double>(problem.grid.size());
      for (const auto& traction : loads.tractions) {
        const Side side = side_named(traction.on);
        const int first = side.axis == 0 ? 1 : 0, second = side.axis == 2 ? 1 : 2;
        std::array<Index, 3> parts{2 * n[0], 2 * n[1], 2 * n[2]};
        const std::vector<float> part = side_averages(image, solid, parts, side.axis, side.upper);
        const double area = 0.25 * edges[first] * edges[second];
        const Vec<3> normal = (side.upper ? 1.0 : -1.0) * Vec<3>::Unit(side.axis);
        for (Index b = 0; b < parts[second]; ++b)
          for (Index a = 0; a < parts[first]; ++a) {
            const double share = part[a + static_cast<std::size_t>(parts[first]) * b];
            if (share == 0.0) continue;
            Vec<3> at = image.origin;
            at[side.axis] += side.upper ? lengths[side.axis] : 0.0;
            at[first] += 0.5 * (a + 0.5) * edges[first];
            at[second] += 0.5 * (b + 0.5) * edges[second];
            const Vec<3> force = area * share * traction.traction(at, normal);
            for (int corner = 0; corner < 4; ++corner) {
              std::array<Index, 3> node;
              node[side.axis] = side.upper ? n[side.axis] : 0;
              node[first] = a / 2 + (corner & 1);
              node[second] = b / 2 + (corner >> 1);
              const double weight = ((corner & 1) == (a & 1) ? 0.75 : 0.25) * ((corner >> 1) == (b & 1) ? 0.75 : 0.25);
              for (int c = 0; c < 3; ++c)
                problem.load[c * problem.grid.nodes() + problem.grid.node(node[0], node[1], node[2])] +=
                    weight * force[c];
            }
          }
      }
      if (level == 0 && !loads.tractions.empty()) require_held_where_loaded(problem);
      if (level == halvings) break;
      mu = internal::halved(mu, n);
      lambda = internal::halved(lambda, n);
      for (Index& m : n) m /= 2;
    }
    mu = lambda = {};
    coarsest.emplace(*problems.back());
  }

  const Stage stage("solve", clock, progress);
  Multigrid precondition(problems, *coarsest);
  CellSolution solution;
  Field u;
  for (std::size_t l = problems.size(); l-- > 0;) {
    const Problem& problem = *problems[l];
    const CellGrid& grid = problem.grid;
    const std::size_t dofs = grid.size();
    Field start = zeros<double>(dofs);
    if (!u.empty()) prolong(problems[l + 1]->grid, grid, u, start);
    u = std::move(start);
    problem.set_held(u);
    Field r(dofs), p, Ap(dofs);
    const bool loaded = !problem.load.empty();
    // Residual where nothing is held; returns u^T K u.
    const auto residual = [&] {
      grid.apply(u.data(), Ap.data());
      const double energy = dot(u, Ap);
      for_all(dofs, [&](std::size_t i) {
        r[i] = problem.inverse_diagonal[i] > 0.0F ? (loaded ? problem.load[i] : 0.0) - Ap[i] : 0.0;
      });
      return energy;
    };
    CellLevel found{.edges = grid.edges, .cells = problem.num_cells()};
    double energy = residual();
    if (l + 1 == problems.size()) {
      p = zeros<double>(dofs);
      coarsest->solve(r, p);
      for_all(dofs, [&](std::size_t i) { u[i] += p[i]; });
      energy = residual();
    } else {
      p = zeros<double>(dofs);
      double rz = 0.0;
      for (;; ++found.iterations) {
        // In single precision small numbers keep their digits only if scaled.
        const double size_of_r = std::sqrt(dot(r, r));
        if (size_of_r == 0.0) break;
        SingleField& b = precondition.right(l);
        for_all(dofs, [&](std::size_t i) { b[i] = static_cast<float>(r[i] / size_of_r); });
        const SingleField& z = precondition(l);
        const double next = size_of_r * dot(r, z);
        if (!std::isfinite(next) || next < 0.0)
          throw NumericalError("the iterations on cells break down: part of the body is loaded, but nothing holds it?");
        found.iteration_error = std::sqrt(next / std::max(energy, 1e-300));
        if (next <= options.tolerance * options.tolerance * energy) break;
        if (found.iterations == options.most)
          throw NumericalError(fmt::format(
              "{} iterations on cells leave a relative error of {:.2g}: part of the body hardly hangs together, or is "
              "loaded and not held",
              options.most, found.iteration_error));
        const double beta = found.iterations == 0 ? 0.0 : next / rz;
        rz = next;
        for_all(dofs, [&](std::size_t i) { p[i] = size_of_r * z[i] + beta * p[i]; });
        grid.apply(p.data(), Ap.data());
        const double curvature =
            summed(dofs, [&](std::size_t i) { return problem.inverse_diagonal[i] > 0.0F ? p[i] * Ap[i] : 0.0; });
        const double alpha = rz / curvature;
        for_all(dofs, [&](std::size_t i) {
          if (problem.inverse_diagonal[i] == 0.0F) return;
          u[i] += alpha * p[i];
          r[i] -= alpha * Ap[i];
        });
      }
      energy = residual();
    }
    if (shrunk && grid.cells == shrunk->cells) {
      shrunk->apply(u.data(), Ap.data());
      solution.half_voxel = std::abs(dot(u, Ap) / energy - 1.0);
    }
    found.strain_energy = 0.5 * energy;
    found.potential = found.strain_energy;
    if (!problem.load.empty()) found.potential -= dot(u, problem.load);
    solution.levels.insert(solution.levels.begin(), found);
    if (progress) progress("solve", std::pow(8.0, -static_cast<double>(l)));
  }
  const Problem& problem = *problems.front();
  const CellGrid& grid = problem.grid;
  solution.grid = {image.origin, grid.edges, grid.cells};
  solution.displacement.setZero(
      3, static_cast<Eigen::Index>(grid.cells[0] + 1) * (grid.cells[1] + 1) * (grid.cells[2] + 1));
  Eigen::Index point = 0;
  for (Index k = 0; k <= grid.cells[2]; ++k)
    for (Index j = 0; j <= grid.cells[1]; ++j)
      for (Index i = 0; i <= grid.cells[0]; ++i, ++point)
        for (int c = 0; c < 3; ++c) solution.displacement(c, point) = u[c * grid.nodes() + grid.node(i, j, k)];
  const auto& levels = solution.levels;
  solution.extrapolated_energy = levels[0].strain_energy;
  double left = 0.0;
  if (levels.size() > 1) {
    double rate = 1.0;
    if (levels.size() > 2) {
      const double before = levels[2].potential - levels[1].potential, last = levels[1].potential - levels[0].potential;
      if (before > 0.0 && last > 0.0) rate = std::clamp(std::log2(before / last), 1.0, 2.0);
    }
    const double share = 1.0 / (std::pow(2.0, rate) - 1.0);
    left = 2.0 * std::abs(levels[1].potential - levels[0].potential) * share;
    solution.extrapolated_energy += share * (levels[0].strain_energy - levels[1].strain_energy);
  }
  solution.grid_error = std::sqrt(left / std::max(2.0 * levels[0].strain_energy, 1e-300));
  return solution;
}

}  // namespace efree
