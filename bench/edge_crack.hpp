// SPDX-License-Identifier: GPL-3.0-or-later
/// A plate with an edge crack under tension and its stress intensity by a J integral, and functions that reach through
/// slits and around corners; tests and the study share it.
#pragma once

#include "efree/analysis/analyse.hpp"
#include "efree/geometry/meshing/planar_domain.hpp"
#include "efree/materials/linear_elastic.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <optional>

namespace efree::bench {

/// [0, 1] x [-1.5, 1.5] with a slit from (0, 0) to (a, 0), pulled by a unit traction on top and bottom; plane strain,
/// E = 1, nu = 0.3.
struct EdgeCrack {
  static constexpr double width = 1.0, half_height = 1.5;
  static constexpr IsotropicModuli moduli{1.0, 0.3};

  double length = 0.5;

  /// K = sqrt(pi a) F(a), F within 0.5 % (Tada, Paris & Irwin, The Stress Analysis of Cracks Handbook, single edge
  /// notch in tension).
  double handbook() const {
    const double a = length;
    return std::sqrt(std::numbers::pi * a) *
           (1.122 - 0.231 * a + 10.55 * a * a - 21.71 * a * a * a + 30.382 * a * a * a * a);
  }

  FineMesh<2> mesh(double size) const {
    return triangulate(shapes::slit_rectangle(0.0, -half_height, width, half_height, {0.0, 0.0}, {length, 0.0}),
                       {.size = size});
  }
  /// Springs a millionth as stiff as the plate keep it from moving rigidly.
  Settings<2> settings(double spacing, std::uint64_t seed = 1) const {
    DisplacementCondition<2> rest{"right", {[](const Vec<2>&) { return 0.0; }, [](const Vec<2>&) { return 0.0; }}, {}};
    rest.stiffness = [](const Vec<2>&) { return 1e-6; };
    return {.common = {.model = {.material = LinearElastic(moduli), .plane = Plane::strain},
                       .approximation = {.spacing = spacing, .seed = seed}},
            .supports = {rest},
            .loads = {.tractions = {tension<2>("top", 1.0), tension<2>("bottom", 1.0)}}};
  }

  /// K of a displacement on the fine mesh: K^2 (1 - nu^2) / E = J = int (s_ij u_i,x - W delta_xj) q,j around the tip, q
  /// falling from 1 within `inner` to 0 beyond `outer` (Li, Shih & Needleman 1985).
  double stress_intensity(const Result<2>& result, double inner, double outer) const {
    const FineSpace<2>& space = result.basis().space;
    const Materials<2> materials({LinearElastic(moduli)}, Plane::strain);
    const VoigtMatrix<2> C = materials.stiffness(0, Vec<2>::Zero()).C;
    const auto rule = simplex_rule<2>(4);
    double J = 0.0;
    for (Index c = 0; c < space.mesh().num_cells(); ++c)
      for (Index g = 0; g < rule.weights.size(); ++g) {
        const auto at = rule.points.col(g);
        const Vec<2> arm = space.position(c, at) - Vec<2>(length, 0.0);
        const double r = arm.norm();
        if (r <= inner || r >= outer) continue;
        const Vec<2> dq = -arm / (r * (outer - inner));
        const Gradient<2> H = gradient_at(space, c, at, result.fields.displacement);
        const Voigt<2> eps = strain_of<2>(H), s = C * eps;
        const Mat<2> sigma{{s[0], s[3]}, {s[3], s[1]}};
        const double W = 0.5 * s.dot(eps);
        J += space.mesh().volume(c) * rule.weights[g] * ((sigma * dq).dot(H.head<2>()) - W * dq[0]);
      }
    return std::sqrt(std::max(0.0, J) * moduli.E / (1.0 - moduli.nu * moduli.nu));
  }
};

/// Functions that reach where no way through the body shorter than their support leads, and the largest of their values
/// there.
struct Leak {
  Index checked = 0;  ///< pairs of a function and a place that do not see each other
  Index pairs = 0;    ///< of these, whose shortest way is longer
  double largest = 0.0;

  /// `corner(place, node)` is the corner that the shortest way goes around; nothing if they see each other.
  template <class Corner> Leak(const Approximation<2>& approximation, double support, const Corner& corner) {
    for (Index dof = 0; dof < approximation.space.size(); ++dof) {
      const auto row = approximation.shape.row(dof);
      for (std::size_t k = 0; k < row.nodes.size(); ++k) {
        const Index node = approximation.node_dofs[row.nodes[k]];
        const std::optional<Vec<2>> around = corner(dof, node);
        if (!around || row.N[k] == 0.0) continue;
        ++checked;
        const auto& x = approximation.space.points();
        if ((x.col(dof) - *around).norm() + (*around - x.col(node)).norm() <= support) continue;
        ++pairs;
        largest = std::max(largest, std::abs(row.N[k]));
      }
    }
  }
};

/// Which corner is in the way where the body is cut along y = 0 but for x in (left, right).
class CutAlongAxis {
 public:
  CutAlongAxis(const FineSpace<2>& space, double left, double right)
      : space_(space), left_(left), right_(right), above_(space.size()) {
    for (Index c = 0; c < space.mesh().num_cells(); ++c)
      for (const Index dof : space.cell(c)) above_[dof] = space.mesh().centroid(c).y() > 0.0;
  }
  std::optional<Vec<2>> operator()(Index a, Index b) const {
    if (above_[a] == above_[b]) return std::nullopt;
    const Vec<2> x = space_.points().col(a), y = space_.points().col(b);
    const double height = std::abs(x.y()) + std::abs(y.y());
    const double crossing = height > 0.0 ? x.x() + (y.x() - x.x()) * std::abs(x.y()) / height : std::min(x.x(), y.x());
    if (crossing < left_) return Vec<2>(left_, 0.0);
    if (crossing > right_) return Vec<2>(right_, 0.0);
    return std::nullopt;
  }

 private:
  const FineSpace<2>& space_;
  double left_, right_;
  std::vector<char> above_;
};

/// [0, 1] x [-1, 1] cut along y = 0 but for a ligament in the middle.
struct Ligament {
  double width = 0.04;

  double left() const { return 0.5 - 0.5 * width; }
  double right() const { return 0.5 + 0.5 * width; }
  FineMesh<2> mesh(double size) const {
    PlanarDomain domain = shapes::rectangle(0.0, -1.0, 1.0, 1.0);
    domain.slits = {{"slit", {{0.0, 0.0}, {left(), 0.0}}}, {"slit", {{right(), 0.0}, {1.0, 0.0}}}};
    return triangulate(domain, {.size = size});
  }
  Settings<2> settings() const {
    return {.common = {.model = {.material = LinearElastic(1.0, 0.3), .plane = Plane::strain}},
            .supports = {clamp<2>("bottom")},
            .loads = {.tractions = {tension<2>("top", 1.0)}}};
  }
};

/// Corner (1/2, 1/2) of shapes::l_shape(1).
struct NotchOfL {
  const FineSpace<2>& space;
  std::optional<Vec<2>> operator()(Index a, Index b) const {
    Vec<2> x = space.points().col(a), y = space.points().col(b);
    if (x.x() > y.x()) std::swap(x, y);
    if (x.x() >= 0.5 || y.x() <= 0.5) return std::nullopt;
    const double at = x.y() + (y.y() - x.y()) * (0.5 - x.x()) / (y.x() - x.x());
    return at > 0.5 ? std::optional<Vec<2>>({0.5, 0.5}) : std::nullopt;
  }
};

}  // namespace efree::bench
