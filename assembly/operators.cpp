// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/assembly/operators.hpp"

#include "efree/core/parallel.hpp"

#include <algorithm>
#include <numeric>

namespace efree {
namespace {

struct Entry {
  Index point;     ///< row of the table
  Index position;  ///< of the node within that row
};

/// For each node, the rows it appears in, ascending.
template <int Dim> Ragged<Entry> transpose_pattern(const ShapeTable<Dim>& shape) {
  Ragged<Entry> by_node;
  by_node.offsets.assign(shape.num_nodes() + 1, 0);
  for (Index p = 0; p < shape.num_points(); ++p)
    for (Index node : shape.row(p).nodes) ++by_node.offsets[node + 1];
  std::partial_sum(by_node.offsets.begin(), by_node.offsets.end(), by_node.offsets.begin());
  by_node.items.resize(by_node.offsets.back());
  std::vector<Index> cursor(by_node.offsets.begin(), by_node.offsets.end() - 1);
  for (Index p = 0; p < shape.num_points(); ++p) {
    const auto row = shape.row(p);
    for (std::size_t k = 0; k < row.nodes.size(); ++k)
      by_node.items[cursor[row.nodes[k]]++] = {p, static_cast<Index>(k)};
  }
  return by_node;
}

}  // namespace

template <> Eigen::Matrix<double, 3, 2> strain_matrix<2>(const Vec<2>& dN) {
  Eigen::Matrix<double, 3, 2> B;
  B << dN.x(), 0.0, 0.0, dN.y(), dN.y(), dN.x();
  return B;
}

template <> Eigen::Matrix<double, 6, 3> strain_matrix<3>(const Vec<3>& dN) {
  Eigen::Matrix<double, 6, 3> B;
  B << dN.x(), 0.0, 0.0,    //
      0.0, dN.y(), 0.0,     //
      0.0, 0.0, dN.z(),     //
      0.0, dN.z(), dN.y(),  //
      dN.z(), 0.0, dN.x(),  //
      dN.y(), dN.x(), 0.0;
  return B;
}

template <int Dim> VoigtPoints<Dim> strain(const Discretization<Dim>& discretization, const Points<Dim>& U) {
  VoigtPoints<Dim> result(voigt_size<Dim>, discretization.size());
  parallel_for(discretization.size(), [&](Index K) {
    const auto row = discretization.shape.row(K);
    Voigt<Dim> sum = Voigt<Dim>::Zero();
    for (std::size_t k = 0; k < row.nodes.size(); ++k) sum += strain_matrix<Dim>(row.dN[k]) * U.col(row.nodes[k]);
    result.col(K) = sum;
  });
  return result;
}

template <int Dim>
Points<Dim> internal_force(const Discretization<Dim>& discretization, const VoigtPoints<Dim>& stress) {
  const auto by_node = transpose_pattern(discretization.shape);
  Points<Dim> force(Dim, discretization.shape.num_nodes());
  parallel_for(discretization.shape.num_nodes(), [&](Index a) {
    Vec<Dim> sum = Vec<Dim>::Zero();
    for (const auto& [K, k] : by_node[a])
      sum += discretization.weights[K] *
             (strain_matrix<Dim>(discretization.shape.row(K).dN[k]).transpose() * stress.col(K));
    force.col(a) = sum;
  });
  return force;
}

template <int Dim>
SymmetricMatrix stiffness_matrix(const Discretization<Dim>& discretization, const VoigtMatrix<Dim>& C) {
  Index regions = 1;
  for (Index region : discretization.region) regions = std::max(regions, region + 1);
  return stiffness_matrix(discretization, std::vector<VoigtMatrix<Dim>>(regions, C));
}

template <int Dim>
SymmetricMatrix stiffness_matrix(const Discretization<Dim>& discretization, const std::vector<VoigtMatrix<Dim>>& C) {
  const ShapeTable<Dim>& shape = discretization.shape;
  const Index nodes = shape.num_nodes();
  const auto by_node = transpose_pattern(shape);

  // Column block of node a: blocks with the nodes b >= a that share a point with it.
  struct Part {
    std::vector<Index> count;  ///< number of blocks per node
    std::vector<Index> rows;   ///< b
    std::vector<Mat<Dim>> blocks;
  };
  const Index chunk = std::max<Index>(64, (nodes + 15) / 16);
  std::vector<Part> parts((nodes + chunk - 1) / chunk);
  parallel_chunks(nodes, chunk, [&](Index begin, Index end) {
    Part& part = parts[begin / chunk];
    std::vector<Index> slot(nodes, -1), touched;
    std::vector<Mat<Dim>> sums;
    for (Index a = begin; a < end; ++a) {
      touched.clear();
      sums.clear();
      for (const auto& [K, k] : by_node[a]) {
        const auto row = shape.row(K);
        const Eigen::Matrix<double, voigt_size<Dim>, Dim> CBa =
            discretization.weights[K] * (C[discretization.region[K]] * strain_matrix<Dim>(row.dN[k]));
        for (std::size_t l = k; l < row.nodes.size(); ++l) {
          const Index b = row.nodes[l];
          if (slot[b] < 0) {
            slot[b] = static_cast<Index>(touched.size());
            touched.push_back(b);
            sums.push_back(Mat<Dim>::Zero());
          }
          sums[slot[b]].noalias() += strain_matrix<Dim>(row.dN[l]).transpose() * CBa;
        }
      }
      std::vector<Index> order = touched;
      std::sort(order.begin(), order.end());
      part.count.push_back(static_cast<Index>(order.size()));
      for (Index b : order) {
        part.rows.push_back(b);
        part.blocks.push_back(sums[slot[b]]);
      }
      for (Index b : touched) slot[b] = -1;
    }
  });

  SymmetricMatrix K(Dim * nodes, Dim * nodes);
  std::vector<Index> offsets{0}, rows;
  std::vector<double> values;
  for (const Part& part : parts) {
    std::size_t first = 0;
    for (Index count : part.count) {
      for (int j = 0; j < Dim; ++j) {
        for (std::size_t s = first; s < first + count; ++s)
          for (int i = 0; i < Dim; ++i) {
            if (s == first && i < j) continue;  // the first block is the diagonal one
            rows.push_back(Dim * part.rows[s] + i);
            values.push_back(part.blocks[s](i, j));
          }
        offsets.push_back(static_cast<Index>(rows.size()));
      }
      first += count;
    }
  }
  return Eigen::Map<const SymmetricMatrix>(Dim * nodes, Dim * nodes, static_cast<Index>(rows.size()), offsets.data(),
                                           rows.data(), values.data());
}

template VoigtPoints<2> strain<2>(const Discretization<2>&, const Points<2>&);
template Points<2> internal_force<2>(const Discretization<2>&, const VoigtPoints<2>&);
template SymmetricMatrix stiffness_matrix<2>(const Discretization<2>&, const VoigtMatrix<2>&);

template SymmetricMatrix stiffness_matrix<2>(const Discretization<2>&, const std::vector<VoigtMatrix<2>>&);
template VoigtPoints<3> strain<3>(const Discretization<3>&, const Points<3>&);
template Points<3> internal_force<3>(const Discretization<3>&, const VoigtPoints<3>&);
template SymmetricMatrix stiffness_matrix<3>(const Discretization<3>&, const VoigtMatrix<3>&);

template SymmetricMatrix stiffness_matrix<3>(const Discretization<3>&, const std::vector<VoigtMatrix<3>>&);

}  // namespace efree
