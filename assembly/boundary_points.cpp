// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/assembly/internal/boundary_points.hpp"

#include "efree/core/internal/spectrum.hpp"

namespace efree::internal {

template <int Dim> Points<Dim> to_nodes(const ShapeTable<Dim>& shape, const Points<Dim>& fine) {
  Points<Dim> nodal = Points<Dim>::Zero(Dim, shape.num_nodes());
  for (Index v = 0; v < shape.num_points(); ++v) {
    if (fine.col(v).isZero(0.0)) continue;
    const auto row = shape.row(v);
    for (std::size_t k = 0; k < row.nodes.size(); ++k) nodal.col(row.nodes[k]) += row.N[k] * fine.col(v);
  }
  return nodal;
}

template <int Dim>
std::optional<Held<Dim>> held_by(const std::vector<Vec<Dim>>& directions, const std::vector<double>& values) {
  const Index count = static_cast<Index>(values.size());
  Eigen::Matrix<double, Dim, Eigen::Dynamic> d(Dim, count);
  for (Index k = 0; k < count; ++k) d.col(k) = directions[k];
  const Vector g = Eigen::Map<const Vector>(values.data(), count);
  const auto [strengths, frame] = spectrum<Dim>(d * d.transpose());
  Held<Dim> held{frame.rowwise().reverse(), 0, Vec<Dim>::Zero()};
  const Vec<Dim> strength = strengths.reverse();
  held.rank = static_cast<int>((strength.array() > 1e-12 * strength[0]).count());
  Vec<Dim> fixed = held.frame.transpose() * (d * g);
  for (int i = 0; i < Dim; ++i) fixed[i] = i < held.rank ? fixed[i] / strength[i] : 0.0;
  held.value = held.frame * fixed;
  if ((d.transpose() * held.value - g).norm() > 1e-9 * (g.norm() + 1e-300)) return std::nullopt;
  return held;
}

void contradict(const std::vector<std::string>& parts, const std::string& place) {
  std::vector<std::string> once;
  for (const std::string& part : parts)
    if (std::ranges::find(once, part) == once.end()) once.push_back(part);
  throw InputError(fmt::format("displacements prescribed on \"{}\" contradict each other at {}",
                               fmt::join(once, "\" and \""), place));
}

template Points<2> to_nodes<2>(const ShapeTable<2>&, const Points<2>&);
template Points<3> to_nodes<3>(const ShapeTable<3>&, const Points<3>&);
template std::optional<Held<2>> held_by<2>(const std::vector<Vec<2>>&, const std::vector<double>&);
template std::optional<Held<3>> held_by<3>(const std::vector<Vec<3>>&, const std::vector<double>&);

}  // namespace efree::internal
