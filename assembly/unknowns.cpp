// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/assembly/internal/unknowns.hpp"

namespace efree::internal {

template <int Dim> Unknowns<Dim>::Unknowns(Index nodes, NodalConditions<Dim> conditions)
    : num_nodes_(nodes), conditions_(std::move(conditions)) {
  if (!conditions_.nodes.empty()) {
    number_.assign(Dim * nodes, 0);
    frame_at_.assign(nodes, -1);
  }
  for (std::size_t k = 0; k < conditions_.nodes.size(); ++k) {
    const Index node = conditions_.nodes[k];
    for (int i = 0; i < conditions_.fixed[k]; ++i) number_[Dim * node + i] = -1;
    if (conditions_.frames[k] != Mat<Dim>::Identity()) frame_at_[node] = static_cast<Index>(k);
  }
  node_of_.reserve(Dim * nodes);
  for (Index node = 0; node < nodes; ++node)
    for (int i = 0; i < Dim; ++i) {
      if (!number_.empty()) {
        if (number_[Dim * node + i] < 0) continue;
        number_[Dim * node + i] = static_cast<Index>(node_of_.size());
      }
      node_of_.push_back(node);
    }
  size_ = static_cast<Index>(node_of_.size());
}

template <int Dim> Vector Unknowns<Dim>::of(const Points<Dim>& forces) const {
  Vector values(size_);
  for (Index node = 0; node < num_nodes_; ++node) {
    const Mat<Dim>* turn = frame(node);
    const Vec<Dim> force = turn ? Vec<Dim>(turn->transpose() * forces.col(node)) : Vec<Dim>(forces.col(node));
    for (int i = 0; i < Dim; ++i)
      if (const Index number = (*this)(node, i); number >= 0) values[number] = force[i];
  }
  return values;
}

template <int Dim> Points<Dim> Unknowns<Dim>::to_nodes(const Vector& values) const {
  Points<Dim> displacements(Dim, num_nodes_);
  for (Index node = 0; node < num_nodes_; ++node) {
    Vec<Dim> local = Vec<Dim>::Zero();
    for (int i = 0; i < Dim; ++i)
      if (const Index number = (*this)(node, i); number >= 0) local[i] = values[number];
    const Mat<Dim>* turn = frame(node);
    displacements.col(node) = turn ? Vec<Dim>(*turn * local) : local;
  }
  return displacements;
}

template <int Dim> Points<Dim> Unknowns<Dim>::prescribe(double factor, Points<Dim> displacements) const {
  for (std::size_t k = 0; k < conditions_.nodes.size(); ++k) {
    auto u = displacements.col(conditions_.nodes[k]);
    Vec<Dim> local = conditions_.frames[k].transpose() * u;
    local.head(conditions_.fixed[k]) = factor * conditions_.values[k].head(conditions_.fixed[k]);
    u = conditions_.frames[k] * local;
  }
  return displacements;
}

template <int Dim> Points<Dim> Unknowns<Dim>::fixed_part(const Points<Dim>& displacements) const {
  Points<Dim> fixed = Points<Dim>::Zero(Dim, num_nodes_);
  for (std::size_t k = 0; k < conditions_.nodes.size(); ++k) {
    const Index node = conditions_.nodes[k];
    Vec<Dim> local = conditions_.frames[k].transpose() * displacements.col(node);
    local.tail(Dim - conditions_.fixed[k]).setZero();
    fixed.col(node) = conditions_.frames[k] * local;
  }
  return fixed;
}

template class Unknowns<2>;
template class Unknowns<3>;

}  // namespace efree::internal
