// SPDX-License-Identifier: GPL-3.0-or-later
/// Bodies that flow at a known load: strip footing and double-edge-notched strip in plane strain; and a bar bent past
/// yield. Tests and the study share them.
#pragma once

#include "efree/analysis/analyse.hpp"
#include "efree/bench/plastic_walls.hpp"

#include <cmath>
#include <functional>
#include <numbers>
#include <string>
#include <vector>

namespace efree::bench {

/// Points from `first` to `last` with edges of `least` at `dense`, growing by a factor away from there up to `most`.
inline std::vector<double> graded_line(double first, double last, double dense, double least, double most,
                                       double factor = 1.12) {
  const auto leg = [&](double length) {  // distances from `dense`
    std::vector<double> at{0.0};
    for (double edge = least; at.back() < length; edge = std::min(most, edge * factor)) at.push_back(at.back() + edge);
    for (double& x : at) x *= length / std::max(at.back(), 1e-300);
    return at;
  };
  std::vector<double> line;
  for (const double x : leg(dense - first)) line.push_back(dense - x);
  std::ranges::reverse(line);
  for (const double x : leg(last - dense))
    if (x > 0.0) line.push_back(dense + x);
  return line;
}
/// Name of a part by the middle of an edge of the boundary.
using NameOfPart = std::function<std::string(const Vec<2>&)>;
/// The grid of these lines, every rectangle cut in two, in turn one way and the other, and its vertices placed.
inline FineMesh<2> grid(
    const std::vector<double>& x, const std::vector<double>& y, const NameOfPart& name,
    const std::function<Vec<2>(const Vec<2>&)>& placed = [](const Vec<2>& at) { return at; }) {
  const Index nx = static_cast<Index>(x.size()), ny = static_cast<Index>(y.size());
  MeshData<2> data;
  data.vertices.resize(2, nx * ny);
  data.cells.resize(3, 2 * (nx - 1) * (ny - 1));
  const auto vertex = [&](Index i, Index j) { return i + nx * j; };
  for (Index j = 0; j < ny; ++j)
    for (Index i = 0; i < nx; ++i) data.vertices.col(vertex(i, j)) = placed({x[i], y[j]});
  Index cell = 0;
  for (Index j = 0; j + 1 < ny; ++j)
    for (Index i = 0; i + 1 < nx; ++i) {
      const Index a = vertex(i, j), b = vertex(i + 1, j), c = vertex(i + 1, j + 1), d = vertex(i, j + 1);
      const bool rising = (i + j) % 2 == 0;
      data.cells.col(cell++) << a, b, (rising ? c : d);
      data.cells.col(cell++) << (rising ? a : b), c, d;
    }
  const auto add = [&](Index a, Index b) {
    const std::string part = name(0.5 * (data.vertices.col(a) + data.vertices.col(b)));
    for (auto& group : data.groups)
      if (group.name == part) return group.facets.push_back({a, b});
    data.groups.push_back({part, {{a, b}}});
  };
  for (Index i = 0; i + 1 < nx; ++i) add(vertex(i, 0), vertex(i + 1, 0)), add(vertex(i, ny - 1), vertex(i + 1, ny - 1));
  for (Index j = 0; j + 1 < ny; ++j) add(vertex(0, j), vertex(0, j + 1)), add(vertex(nx - 1, j), vertex(nx - 1, j + 1));
  return FineMesh<2>(data);
}

/// A body, what happens to it until the end of the path, and the part whose force per area comes to a limit.
struct LimitCase {
  FineMesh<2> mesh;
  Settings<2> settings;
  std::string part;
  double area, limit;

  /// Mean stress on the part.
  double stress(const HistoryStep<2>& step) const { return std::abs(step.reactions.at(part).force[1]) / area; }
};
/// Spacing of a cloud (of elements: their edges), and at the edge where the flow turns.
struct Resolution {
  double spacing, at_edge;
  double cells = 3.0;  ///< fine edges to a spacing
};
inline Settings<2> plane_strain(const Metal& metal, ApproximationOptions options, const Resolution& resolution,
                                const Vec<2>& edge) {
  Settings<2> settings;
  settings.common.model.material = metal.material();
  settings.common.model.plane = Plane::strain;
  options.spacing = resolution.spacing;
  const double reach = resolution.at_edge;
  options.grading.boxes = {{{edge[0] - reach, edge[1] - reach}, {edge[0] + reach, edge[1] + reach}, reach}};
  settings.common.approximation = options;
  settings.time = TimeSettings<2>{.path = {.step = 0.05}};
  return settings;
}
inline FineMesh<2> dense_at(const Vec<2>& edge, const Vec<2>& size, const Resolution& resolution,
                            const NameOfPart& name) {
  const double least = resolution.at_edge / resolution.cells, most = resolution.spacing / resolution.cells;
  return grid(graded_line(0.0, size[0], edge[0], least, most), graded_line(0.0, size[1], edge[1], least, most), name);
}

/// Half of a strip footing of half width 1, smooth and rigid, pressed into a block 5 wide and 4 deep: (2 + pi) k
/// (Prandtl 1920, Hill 1950, chapter IX.5).
inline LimitCase footing(const ApproximationOptions& options, const Resolution& resolution) {
  const Metal metal;
  const Vec<2> edge(1.0, 4.0);
  FineMesh<2> mesh = dense_at(edge, {5.0, 4.0}, resolution, [](const Vec<2>& x) -> std::string {
    if (x[1] > 4.0 - 1e-9) return x[0] < 1.0 ? "footing" : "top";
    return x[1] < 1e-9 ? "bottom" : x[0] < 1e-9 ? "left" : "right";
  });
  Settings<2> settings = plane_strain(metal, options, resolution, edge);
  settings.supports = {symmetry_plane<2>("left"),
                       symmetry_plane<2>("right"),
                       symmetry_plane<2>("bottom"),
                       {"footing", {ScalarField<2>{}, [](const Vec<2>&) { return -0.05; }}, {}}};
  return {std::move(mesh), std::move(settings), "footing", 1.0,
          (2.0 + std::numbers::pi) * metal.yield / std::sqrt(3.0)};
}

/// A quarter of a strip of half width 5 and half length 10 with two cuts, pulled: the ligament, of half width 1/2, is
/// so narrow that it bears (2 + pi) k (Hill 1952; Nagtegaal, Parks & Rice 1974).
inline LimitCase notched_strip(const ApproximationOptions& options, const Resolution& resolution) {
  const Metal metal{.E = 206.9, .nu = 0.29, .yield = 0.45};
  const Vec<2> edge(0.5, 0.0);
  FineMesh<2> mesh = dense_at(edge, {5.0, 10.0}, resolution, [](const Vec<2>& x) -> std::string {
    if (x[1] < 1e-9) return x[0] < 0.5 ? "ligament" : "cut";
    return x[1] > 10.0 - 1e-9 ? "top" : x[0] < 1e-9 ? "left" : "right";
  });
  Settings<2> settings = plane_strain(metal, options, resolution, edge);
  settings.supports = {symmetry_plane<2>("left"),
                       symmetry_plane<2>("ligament"),
                       {"top", {ScalarField<2>{}, [](const Vec<2>&) { return 0.12; }}, {}}};
  return {std::move(mesh), std::move(settings), "ligament", 0.5,
          (2.0 + std::numbers::pi) * metal.yield / std::sqrt(3.0)};
}

/// Half of a bar of depth 2 in plane stress, bent to three times the curvature of first yield and let go: with c the
/// half depth of what is still elastic, M = (1 - c^2 / 3) yield, and the bar springs back by M / (2/3 E) (Timoshenko &
/// Gere). The lower edge of the half is the neutral axis and moves as the curvature says.
struct BentBar {
  static constexpr double length = 2.0, times = 3.0;
  Metal metal;

  double first_yield() const { return metal.yield / metal.E; }
  /// Of the half, about the axis: whole bar / 2.
  double moment() const { return 0.5 * (1.0 - 1.0 / (3.0 * times * times)) * metal.yield; }
  /// That is left when it is let go.
  double residual_curvature() const { return times * first_yield() - 3.0 * moment() / metal.E; }
  double curvature(double t) const {
    const double most = times * first_yield();
    return t < 1.0 ? t * most : most + (t - 1.0) * (residual_curvature() - most);
  }
  /// Along the bar, at a height, afterwards.
  double residual_stress(double y) const {
    return std::min(metal.E * times * first_yield() * y, metal.yield) - 3.0 * moment() * y;
  }
  FineMesh<2> mesh(double size) const { return triangulate(shapes::rectangle(0.0, 0.0, length, 1.0), {.size = size}); }
  Settings<2> settings(const ApproximationOptions& options) const {
    Settings<2> settings;
    settings.common.model.material = metal.material();
    settings.common.model.plane = Plane::stress;
    settings.common.approximation = options;
    const auto supports = [*this](double time) {
      const double k = curvature(time);
      const ScalarField<2> along = [k](const Vec<2>& x) { return k * x[0] * x[1]; };
      const ScalarField<2> down = [k](const Vec<2>& x) { return -0.5 * k * x[0] * x[0]; };
      return std::vector<DisplacementCondition<2>>{
          {"left", {along, {}}, {}}, {"right", {along, {}}, {}}, {"bottom", {along, down}, {}}};
    };
    settings.supports = supports(2.0);
    settings.time = {{.end = 2.0, .step = 0.1, .stops = {1.0}}, {}, [supports](double time) {
                       return Acting<2>{supports(time), {}};
                     }};
    return settings;
  }
};

}  // namespace efree::bench
