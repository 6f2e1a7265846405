// SPDX-License-Identifier: GPL-3.0-or-later
/// A basis of your own: bilinear functions on a grid of squares that knows nothing of the body in it, a plate with a
/// hole. Values at the fine vertices are all that a basis has to bring.
///
///    +--+--+--+    div sigma = 0,   sigma = C : sym(grad u)
///    ||-+--+-||    all around, on the hole too: u = (x + y / 4, -y / 2), which then is the solution
///    + \+--+-|+
///
/// Prints the largest error at any fine vertex.
#include <array>
#include <cmath>
#include <cstdio>
#include <efree/efree.hpp>
#include <map>

using namespace efree;

static Approximation<2> grid_basis(const FineMesh<2>& mesh, double size) {
  std::map<std::array<Index, 2>, Index> number;  // of the grid's points that have a function in the body
  std::vector<Vec<2>> nodes;
  const Vec<2> shift(0.3, 0.3);  // of the grid against the sides of the body
  std::vector<Offset> offsets{0};
  std::vector<Index> columns;
  std::vector<double> N;
  for (Index v = 0; v < mesh.num_vertices(); ++v) {
    const Vec<2> at = mesh.vertex(v) / size + shift;
    std::map<Index, double> row;  // ascending
    for (const int corner : {0, 1, 2, 3}) {
      const std::array<Index, 2> point{static_cast<Index>(std::floor(at.x())) + corner % 2,
                                       static_cast<Index>(std::floor(at.y())) + corner / 2};
      const double value = (1.0 - std::abs(at.x() - point[0])) * (1.0 - std::abs(at.y() - point[1]));
      const auto [found, is_new] = number.try_emplace(point, static_cast<Index>(nodes.size()));
      if (is_new) nodes.push_back(size * (Vec<2>(point[0], point[1]) - shift));
      row[found->second] = value;
    }
    for (const auto& [node, value] : row) columns.push_back(node), N.push_back(value);
    offsets.push_back(static_cast<Offset>(columns.size()));
  }
  Approximation<2> basis;
  basis.space = FineSpace<2>(mesh, 1);
  basis.nodes = Eigen::Map<const Points<2>>(nodes[0].data(), 2, static_cast<Index>(nodes.size()));
  basis.shape = {static_cast<Index>(nodes.size()), offsets, columns, N};
  basis.quadrature = project(basis.space, basis.shape, every_cell(basis.space));
  return basis;
}

int main() {
  const FineMesh<2> mesh = triangulate(shapes::quarter_plate_with_hole(0.25, 1.0, 0.04), {.size = 0.04});
  const Mat<2> F{{1.0, 0.25}, {0.0, -0.5}};
  std::vector<DisplacementCondition<2>> all;
  for (const char* on : {"left", "bottom", "right", "top", "hole"})
    all.push_back(
        {on, {[F](const Vec<2>& x) { return F.row(0) * x; }, [F](const Vec<2>& x) { return F.row(1) * x; }}, {}});
  const Approximation<2> basis = grid_basis(mesh, 0.2);
  const ElasticSolver<2> solver(basis, {.material = LinearElastic(1.0, 0.3), .plane = Plane::stress}, all);
  const Points<2> u = interpolate(basis.shape, solver.solve({}).coefficients);
  const double error = (u - F * mesh.vertices()).colwise().norm().maxCoeff();
  std::printf("%d functions on %d fine vertices: error %.1e\n", basis.shape.num_nodes(), mesh.num_vertices(), error);
  return error < 1e-11 ? 0 : 1;
}
