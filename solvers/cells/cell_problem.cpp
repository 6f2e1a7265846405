// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/solvers/cells/internal/cell_problem.hpp"

#include "efree/core/error.hpp"
#include "efree/core/internal/spectrum.hpp"
#include "efree/core/memory.hpp"
#include "efree/geometry/input/box_averages.hpp"

#include <fmt/format.h>
#include <Eigen/Geometry>
#include <cmath>
#include <limits>
#include <numeric>
#include <string_view>

namespace efree {
namespace {

constexpr std::array<std::string_view, 6> sides{"left", "right", "front", "back", "bottom", "top"};

/// C_xyxy and C_xxyy.
struct Isotropic {
  double shear, across;
};
/// Those of a tangent by P and F, if it is isotropic.
std::optional<Isotropic> isotropic(const MaterialResponse::Tangent& A) {
  const Isotropic one{A(3, 3), A(0, 4)};
  MaterialResponse::Tangent same = MaterialResponse::Tangent::Zero();
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j < 3; ++j) {
      same(4 * i, 4 * j) += one.across;
      same(i + 3 * j, i + 3 * j) += one.shear;
      same(i + 3 * j, j + 3 * i) += one.shear;
    }
  if (!((A - same).norm() < 1e-9 * A.norm())) return {};
  return one;
}

/// At a point of each column.
MaterialResponse tangents(const Material& material, Points<3> X) {
  return respond(material, Deformation::none(std::move(X), material.history_size()), true);
}

}  // namespace

bool is_isotropic(const SharedMaterial& material, const Vec<3>& X) {
  return isotropic(tangents(*material, X).tangent_at(0)).has_value();
}

bool is_side(const std::string& name) {
  return std::ranges::find(sides, name) != sides.end();
}

namespace internal {
namespace {

using Triple = std::array<Index, 3>;

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

std::string text(const Vec<3>& x) {
  return fmt::format("({:.6g}, {:.6g}, {:.6g})", x[0], x[1], x[2]);
}

std::vector<HeldSide> held_sides(const std::vector<DisplacementCondition<3>>& conditions) {
  std::vector<HeldSide> held;
  for (const auto& condition : conditions) {
    if (condition.stiffness) throw InputError("on cells there are no elastic supports");
    const Side side = side_named(condition.on);
    for (int c = 0; c < 3; ++c)
      if (condition.components[c]) held.push_back({condition.on, side, c, condition.components[c]});
    if (condition.normal)
      held.push_back(
          {condition.on, side, side.axis,
           [value = condition.normal, sign = side.upper ? 1.0 : -1.0](const Vec<3>& x) { return sign * value(x); }});
  }
  return held;
}

/// Cells of the grids, from fine to coarse: edges of at most `size` on the finest, 6 to 12 cells along each axis on the
/// last, or as many as keep it small; each axis is halved at least twice, as three grids tell the error.
std::vector<Triple> grid_cells(const Vec<3>& lengths, double size) {
  constexpr double few = 2500.0;  // points, which are solved directly
  Triple n;
  std::array<int, 3> halvings;
  double points = 1.0;
  for (int d = 0; d < 3; ++d) {
    const double wanted = std::ceil(lengths[d] / size - 1e-9);
    halvings[d] = std::max(2, static_cast<int>(std::floor(std::log2(std::max(wanted, 1.0) / 6.0))));
    const double whole = std::ceil(wanted / std::pow(2.0, halvings[d])) * std::pow(2.0, halvings[d]);
    points *= whole + 1.0 + (d == 0 ? 1.5 * CellGrid::lanes : 0.0);
    n[d] = static_cast<Index>(std::min(whole, 1e9));
  }
  require_memory(cell_memory * points, fmt::format("a grid of {} x {} x {} cells", n[0], n[1], n[2]),
                 "use larger cells (mesh_size)");
  std::vector<Triple> cells{n};
  const auto size_of = [](const Triple& c) { return (c[0] + 1.0) * (c[1] + 1.0) * (c[2] + 1.0); };
  while (cells.size() < 3 || size_of(cells.back()) > few) {
    bool any = false;
    for (int d = 0; d < 3; ++d)
      if (halvings[d]-- > 0) {
        n[d] /= 2;
        any = true;
      }
    if (!any) break;
    cells.push_back(n);
  }
  return cells;
}

/// What all of a are of b, if it is the same; where b is 0 it does not count.
std::optional<float> common_ratio(const std::vector<float>& a, const std::vector<float>& b) {
  std::optional<float> ratio;
  for (std::size_t i = 0; i < a.size(); ++i) {
    if (b[i] == 0.0F) continue;
    if (!ratio) ratio = a[i] / b[i];
    if (std::abs(a[i] - *ratio * b[i]) > 1e-6F * std::abs(a[i])) return {};
  }
  return ratio;
}

/// C_xyxy and C_xxyy by part of a grid's cells.
struct Parts {
  std::vector<float> shear, across;
};

/// Centre of the first pixel with that label.
Vec<3> first_place(const LabelImage<3>& image, Label label) {
  auto pixel = static_cast<std::size_t>(std::ranges::find(image.labels, label) - image.labels.begin());
  Vec<3> at;
  for (int d = 0; d < 3; pixel /= image.size[d++]) at[d] = static_cast<double>(pixel % image.size[d]) + 0.5;
  return image.origin + at.cwiseProduct(image.spacing);
}

/// Stiffness of the labels, C_xyxy and C_xxyy, in units of the largest C_xyxy (where it varies: of that at some point).
struct LabelStiffness {
  std::vector<float> shear, across, solid;                ///< by label; the first two 0 where they vary
  std::vector<std::pair<Label, SharedMaterial>> varying;  ///< materials that differ from place to place
  double unit = 0.0;                                      ///< [stress]
  float least_ratio = std::numeric_limits<float>::max(), most_ratio = std::numeric_limits<float>::lowest();

  LabelStiffness(const LabelImage<3>& image, const std::vector<SharedMaterial>& materials)
      : shear(materials.size(), 0.0F), across(shear), solid(shear) {
    std::vector<VoigtMatrix<3>> C(materials.size(), VoigtMatrix<3>::Zero());
    for (const LabelCount& count : count_labels(image)) {
      if (count.label == 0) continue;
      if (count.label >= materials.size())
        throw InputError(fmt::format("the image has the label {}, which has no material", count.label));
      const SharedMaterial& material = materials[count.label];
      const Vec<3> place = first_place(image, count.label);
      if (!is_isotropic(material, place))
        throw InputError(fmt::format("on cells materials are isotropic; that of label {} is not", count.label));
      const VoigtMatrix<3> there = Materials<3>({material}, Plane::strain).stiffness(0, place).C;
      solid[count.label] = 1.0F;
      unit = std::max(unit, there(5, 5));
      if (material->homogeneous())
        C[count.label] = there;
      else
        varying.emplace_back(count.label, material);
    }
    if (unit == 0.0) throw InputError("all of the image is void");
    for (std::size_t l = 0; l < C.size(); ++l) {
      if (C[l](5, 5) == 0.0) continue;
      shear[l] = static_cast<float>(C[l](5, 5) / unit);
      across[l] = static_cast<float>(C[l](0, 1) / unit);
      const auto ratio = static_cast<float>(C[l](0, 1) / C[l](5, 5));
      least_ratio = std::min(least_ratio, ratio);
      most_ratio = std::max(most_ratio, ratio);
    }
  }

  /// So that they hold those of all parts.
  void widen_ratios(const Parts& parts) {
    for (std::size_t i = 0; i < parts.shear.size(); ++i) {
      if (!(parts.shear[i] > 0.0F)) continue;
      const float ratio = parts.across[i] / parts.shear[i];
      least_ratio = std::min(least_ratio, ratio);
      most_ratio = std::max(most_ratio, ratio);
    }
  }
};

/// Adds what a material that differs from place to place has in each part.
void add_varying(const LabelImage<3>& image, Label label, const Material& material, double unit, const Triple& boxes,
                 double grown, Parts& parts) {
  std::vector<float> one(label + 1, 0.0F);
  one[label] = 1.0F;
  const std::vector<float> share = box_averages(image, one, boxes, grown);
  Vec<3> edges;
  Triple samples;  // along each axis of a part
  for (int d = 0; d < 3; ++d) {
    edges[d] = image.size[d] * image.spacing[d] / boxes[d];
    samples[d] = std::max(1, static_cast<int>(std::ceil(edges[d] / (2.0 * image.spacing[d]) - 1e-9)));
  }
  const Index of_part = samples[0] * samples[1] * samples[2];
  parallel_chunks(boxes[1] * boxes[2], 16, [&](Index begin, Index end) {
    for (Index row = begin; row < end; ++row) {
      const std::size_t first = static_cast<std::size_t>(row) * boxes[0];
      std::vector<Index> there;
      for (Index i = 0; i < boxes[0]; ++i)
        if (share[first + i] > 0.0F) there.push_back(i);
      if (there.empty()) continue;
      Points<3> X(3, of_part * static_cast<Index>(there.size()));
      Index p = 0;
      for (const Index i : there)
        for (Index s = 0; s < of_part; ++s, ++p) {
          const Triple part{i, row % boxes[1], row / boxes[1]},
              sample{s % samples[0], s / samples[0] % samples[1], s / samples[0] / samples[1]};
          for (int d = 0; d < 3; ++d) X(d, p) = image.origin[d] + edges[d] * (part[d] + (sample[d] + 0.5) / samples[d]);
        }
      const MaterialResponse response = tangents(material, X);
      for (std::size_t k = 0; k < there.size(); ++k) {
        Isotropic sum{0.0, 0.0};
        for (Index s = 0; s < of_part; ++s) {
          p = static_cast<Index>(k) * of_part + s;
          const auto here = isotropic(response.tangent_at(p));
          if (!here)
            throw InputError(
                fmt::format("on cells materials are isotropic; that of label {} is not at {}", label, text(X.col(p))));
          sum.shear += here->shear;
          sum.across += here->across;
        }
        const std::size_t at = first + there[k];
        const double weight = share[at] / (of_part * unit);
        parts.shear[at] += static_cast<float>(weight * sum.shear);
        parts.across[at] += static_cast<float>(weight * sum.across);
      }
    }
  });
}

Parts parts_of(const LabelImage<3>& image, const LabelStiffness& stiffness, const Triple& cells, double grown) {
  const Triple boxes{2 * cells[0], 2 * cells[1], 2 * cells[2]};
  Parts parts{box_averages(image, stiffness.shear, boxes, grown), {}};
  if (const auto ratio = common_ratio(stiffness.across, stiffness.shear)) {
    parts.across.resize(parts.shear.size());
    for_all(parts.shear.size(), [&](std::size_t i) { parts.across[i] = *ratio * parts.shear[i]; });
  } else {
    parts.across = box_averages(image, stiffness.across, boxes, grown);
  }
  for (const auto& [label, material] : stiffness.varying)
    add_varying(image, label, *material, stiffness.unit, boxes, grown, parts);
  return parts;
}

/// Nodes of a side that material reaches, from its parts in the side's rectangles.
std::vector<char> reached_nodes(const CellProblem& problem, const Side& side, const std::vector<float>& parts) {
  const Index a = problem.grid.cells[side.first()], b = problem.grid.cells[side.second()];
  std::vector<char> reached(static_cast<std::size_t>(a + 1) * (b + 1), 0);
  for (Index j = 0; j < 2 * b; ++j)
    for (Index i = 0; i < 2 * a; ++i)
      if (parts[i + static_cast<std::size_t>(2 * a) * j] > 0.0F)
        for (int c = 0; c < 4; ++c) reached[i / 2 + (c & 1) + static_cast<std::size_t>(a + 1) * (j / 2 + (c >> 1))] = 1;
  return reached;
}

/// Calls f(i, j, centre, area of material) for the rectangles of a side that have some.
template <class F>
void for_parts(const CellProblem& problem, const Side& side, const std::vector<float>& parts, const F& f) {
  const int first = side.first(), second = side.second();
  const Triple& n = problem.grid.cells;
  Triple node{};
  node[side.axis] = side.upper ? n[side.axis] : 0;
  for (Index b = 0; b < 2 * n[second]; ++b)
    for (Index a = 0; a < 2 * n[first]; ++a) {
      const double share = parts[a + static_cast<std::size_t>(2 * n[first]) * b];
      if (share == 0.0) continue;
      Vec<3> at = problem.place(node);
      at[first] = problem.origin[first] + 0.5 * (a + 0.5) * problem.edges[first];
      at[second] = problem.origin[second] + 0.5 * (b + 0.5) * problem.edges[second];
      f(a, b, at, 0.25 * problem.edges[first] * problem.edges[second] * share);
    }
}

/// Adds the work-equivalent forces of a traction, unscaled. Returns what they are together.
Resultant<3> add_traction(CellProblem& problem, const Side& side, const TractionCondition<3>& traction,
                          const std::vector<float>& parts) {
  Resultant<3> sum;
  const Vec<3> normal = (side.upper ? 1.0 : -1.0) * Vec<3>::Unit(side.axis);
  Triple node{};
  node[side.axis] = side.upper ? problem.grid.cells[side.axis] : 0;
  for_parts(problem, side, parts, [&](Index a, Index b, const Vec<3>& at, double area) {
    const Vec<3> t = traction.traction(at, normal);
    if (!t.allFinite())
      throw InputError(fmt::format("{} on \"{}\" is {} at {}, expected finite numbers", traction.kind, traction.on,
                                   text(t), text(at)));
    for (int corner = 0; corner < 4; ++corner) {
      Triple to = node;
      to[side.first()] = a / 2 + (corner & 1);
      to[side.second()] = b / 2 + (corner >> 1);
      const double weight = ((corner & 1) == (a & 1) ? 0.75 : 0.25) * ((corner >> 1) == (b & 1) ? 0.75 : 0.25);
      const Vec<3> force = weight * area * t;
      for (int c = 0; c < 3; ++c) problem.load[problem.dof(c, to)] += force[c];
      sum.add(problem.place(to), force);
    }
  });
  return sum;
}

/// Throws InputError if two sides ask for different displacements of a node they share.
void require_agreement(const CellProblem& problem) {
  const std::vector<HeldSide>& held = *problem.held;
  for (std::size_t a = 0; a < held.size(); ++a)
    for (std::size_t b = 0; b < a; ++b) {
      if (held[a].component != held[b].component) continue;
      const Side& side = held[b].side;
      if (side.axis == held[a].side.axis && side.upper != held[a].side.upper) continue;
      const Index there = side.upper ? problem.grid.cells[side.axis] : 0;
      problem.for_held(a, [&](const Triple& node) {
        if (node[side.axis] != there) return;
        const Vec<3> x = problem.place(node);
        const double one = held[a].value(x), other = held[b].value(x);
        if (std::abs(one - other) > 1e-9 * std::max(std::abs(one), std::abs(other)))
          throw InputError(fmt::format("displacements prescribed on \"{}\" and \"{}\" contradict each other at {}",
                                       held[b].on, held[a].on, text(x)));
      });
    }
}

/// Throws InputError naming the place of a body that is loaded, but not held against the motion its loads ask for.
/// Bodies are cells with a point in common.
void require_held_where_loaded(const CellProblem& problem) {
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
  const Vec<3> middle = problem.place({n[0] / 2, n[1] / 2, n[2] / 2});
  const double length = problem.edges.cwiseProduct(Vec<3>(n[0], n[1], n[2])).norm();
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
        const Vec<3> arm = (problem.place({x, y, z}) - middle) / length;
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
    const auto [stiffness, motions] = internal::spectrum<6>(held);
    for (int m = 0; m < 6; ++m)
      if (stiffness[m] < 1e-9 * std::max(1.0, held.trace()) && std::abs(motions.col(m).dot(load)) > 1e-6 * forces) {
        const Vec<3> at = problem.place({i0, j0, k0});
        throw InputError(fmt::format(
            "the body at ({:.6g}, {:.6g}, {:.6g}) is loaded, but free to move: prescribe displacements that "
            "hold it",
            at[0], at[1], at[2]));
      }
  });
}

}  // namespace

void CellProblem::set_held(Field& u) const {
  for (std::size_t condition = 0; condition < held->size(); ++condition) {
    const HeldSide& h = (*held)[condition];
    for_held(condition, [&](const Triple& node) {
      const double value = h.value(place(node));
      if (!std::isfinite(value))
        throw InputError(fmt::format("the displacement prescribed on \"{}\" is {} at {}, expected a finite number",
                                     h.on, value, text(place(node))));
      u[dof(h.component, node)] = value;
    });
  }
}

Resultants<3> CellProblem::reactions(const Field& out_of_balance) const {
  std::array<std::vector<const HeldSide*>, 3> holding;
  for (const HeldSide& one : *held) holding[one.component].push_back(&one);
  Resultants<3> sums;
  for (int c = 0; c < 3; ++c) {
    const auto count = holding[c].size();
    if (count == 0) continue;
    std::vector<std::vector<Resultant<3>>> layers(grid.cells[2] + 1, std::vector<Resultant<3>>(count));
    parallel_chunks(grid.cells[2] + 1, 4, [&](Index begin, Index end) {
      std::vector<double> shares(count, 1.0);
      for (Index k = begin; k < end; ++k)
        for (Index j = 0; j <= grid.cells[1]; ++j)
          for (Index i = 0; i <= grid.cells[0]; ++i) {
            const Triple node{i, j, k};
            const double force = out_of_balance[dof(c, node)];
            if (force == 0.0) continue;
            if (count > 1) {
              double sum = 0.0;
              for (std::size_t s = 0; s < count; ++s) {
                const Side& side = holding[c][s]->side;
                const Index steps = side.upper ? grid.cells[side.axis] - node[side.axis] : node[side.axis];
                shares[s] = steps == 0 ? 1e30 : 1.0 / (steps * edges[side.axis]);
                sum += shares[s];
              }
              for (double& share : shares) share /= sum;
            }
            for (std::size_t s = 0; s < count; ++s) layers[k][s].add(place(node), shares[s] * force * Vec<3>::Unit(c));
          }
    });
    for (const auto& layer : layers)
      for (std::size_t s = 0; s < count; ++s) sums[holding[c][s]->on] += layer[s];
  }
  return sums;
}

Index CellProblem::num_cells() const {
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

CellProblems make_cell_problems(const LabelImage<3>& image, const std::vector<SharedMaterial>& materials,
                                const std::vector<DisplacementCondition<3>>& conditions, const Loads<3>& loads,
                                const CellOptions& options) {
  check_image(image);
  if (!(options.size >= 0.0)) throw InputError(fmt::format("the size of cells is {}, expected > 0", options.size));
  if (loads.inside()) throw InputError("on cells there are no body forces");
  Vec<3> lengths;
  for (int d = 0; d < 3; ++d) lengths[d] = image.size[d] * image.spacing[d];
  const std::vector<Triple> cells =
      grid_cells(lengths, options.size > 0.0 ? options.size : 2.0 * image.spacing.maxCoeff());
  LabelStiffness stiffness(image, materials);
  const double unit_length = lengths.cwiseQuotient(Vec<3>(cells[0][0], cells[0][1], cells[0][2])).maxCoeff();

  CellProblems problems{held_sides(conditions), {}, stiffness.unit * unit_length, {}, {}};
  Parts parts = parts_of(image, stiffness, cells[0], 0.0);
  if (!stiffness.varying.empty()) stiffness.widen_ratios(parts);
  CellEigenvalues eigenvalues{};
  for (std::size_t l = 0; l < cells.size(); ++l) {
    const Triple& n = cells[l];
    std::array<int, 3> ratio{1, 1, 1};
    if (l > 0) {
      for (int d = 0; d < 3; ++d) ratio[d] = cells[l - 1][d] / n[d];
      parts = {halved(parts.shear, cells[l - 1], ratio), halved(parts.across, cells[l - 1], ratio)};
    }
    const Vec<3> edges = lengths.cwiseQuotient(Vec<3>(n[0], n[1], n[2]));
    if (l == 0 || ratio[0] != ratio[1] || ratio[1] != ratio[2])
      eigenvalues = largest_eigenvalues(edges / unit_length, stiffness.least_ratio, stiffness.most_ratio);
    if (options.half_voxel && l == std::min<std::size_t>(1, cells.size() - 1)) {
      const Parts less = parts_of(image, stiffness, n, -0.5);
      problems.shrunk.emplace(n, edges / unit_length, less.shear, less.across);
    }
    problems.grids.push_back(
        std::make_unique<CellProblem>(CellProblem{CellGrid(n, edges / unit_length, parts.shear, parts.across),
                                                  image.origin,
                                                  edges,
                                                  ratio,
                                                  &problems.held,
                                                  {},
                                                  {},
                                                  {}}));
    CellProblem& problem = *problems.grids.back();
    std::array<std::vector<float>, 6> sides;  // material in their rectangles, of those that are asked for
    const auto on_side = [&](const Side& side) -> const std::vector<float>& {
      std::vector<float>& averages = sides[2 * side.axis + side.upper];
      if (averages.empty())
        averages = side_averages(image, stiffness.solid, {2 * n[0], 2 * n[1], 2 * n[2]}, side.axis, side.upper);
      return averages;
    };
    for (const HeldSide& held : problems.held)
      problem.reached.push_back(reached_nodes(problem, held.side, on_side(held.side)));
    problem.inverse_diagonal = problem.grid.bound(eigenvalues);
    for_all(problem.inverse_diagonal.size(), [&](std::size_t i) {
      float& d = problem.inverse_diagonal[i];
      d = d > 0.0F ? 1.0F / d : 0.0F;
    });
    for (std::size_t condition = 0; condition < problems.held.size(); ++condition)
      problem.for_held(condition, [&](const Triple& node) {
        problem.inverse_diagonal[problem.dof(problems.held[condition].component, node)] = 0.0F;
      });
    if (!loads.tractions.empty() || !loads.resultants.empty()) {
      problem.load = zeros<double>(problem.grid.size());
      const auto apply = [&](const TractionCondition<3>& traction) {
        const Side side = side_named(traction.on);
        const Resultant<3> of = add_traction(problem, side, traction, on_side(side));
        if (l == 0) problems.applied.push_back({traction.on, traction.kind, of});
      };
      for (const auto& traction : loads.tractions) apply(traction);
      for (const auto& load : loads.resultants) {
        const Side side = side_named(load.on);
        AreaMoments<3> part;
        for_parts(problem, side, on_side(side),
                  [&](Index, Index, const Vec<3>& at, double area) { part.add(at, area); });
        apply(part.traction(load));
      }
      for_all(problem.load.size(), [&](std::size_t i) { problem.load[i] /= problems.unit; });
    }
    if (l > 0) continue;
    require_agreement(problem);
    if (!problem.load.empty()) require_held_where_loaded(problem);
  }
  return problems;
}

}  // namespace internal
}  // namespace efree
