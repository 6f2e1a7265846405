// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/dynamics/internal/surface_functions.hpp"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>

namespace efree::internal {
namespace {

/// Variance of the nodes' positions, by their weights, below which they lie in a line (plane) [spacing^2].
constexpr double least_variance = 1e-4;

}  // namespace

template <int Dim>
std::vector<std::pair<Index, double>> moving_least_squares(const std::vector<WeightedNode<Dim>>& nodes) {
  double sum = 0.0;
  Vec<Dim> mean = Vec<Dim>::Zero();
  for (const auto& [node, apart, weight] : nodes) {
    sum += weight;
    mean += weight * apart;
  }
  std::vector<std::pair<Index, double>> result;
  if (!(sum > 0.0)) return result;
  mean /= sum;
  Mat<Dim> variance = Mat<Dim>::Zero();
  for (const auto& [node, apart, weight] : nodes)
    variance += weight / sum * (apart - mean) * (apart - mean).transpose();
  const Mat<Dim> least = variance - least_variance * Mat<Dim>::Identity();
  const bool is_spread = Eigen::LLT<Mat<Dim>>(least).info() == Eigen::Success;
  const Vec<Dim> slope = is_spread ? Vec<Dim>(variance.llt().solve(mean)) : Vec<Dim>(Vec<Dim>::Zero());
  double left = 1.0;
  std::size_t largest = 0;
  for (const auto& [node, apart, weight] : nodes) {
    const double value = weight / sum * (1.0 - slope.dot(apart - mean));
    if (value == 0.0) continue;
    result.emplace_back(node, value);
    left -= value;
    if (std::abs(value) > std::abs(result[largest].second)) largest = result.size() - 1;
  }
  result[largest].second += left;
  return result;
}

void append_row(std::vector<std::pair<Index, double>> row, Index number, SparseRows& rows) {
  std::ranges::sort(row);
  rows.startVec(number);
  for (const auto& [node, value] : row) rows.insertBack(number, node) = value;
}

template std::vector<std::pair<Index, double>> moving_least_squares(const std::vector<WeightedNode<2>>&);
template std::vector<std::pair<Index, double>> moving_least_squares(const std::vector<WeightedNode<3>>&);

}  // namespace efree::internal
