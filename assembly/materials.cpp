// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/assembly/materials.hpp"

#include "efree/core/error.hpp"
#include "efree/core/parallel.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <Eigen/Cholesky>
#include <algorithm>
#include <array>

namespace efree {
namespace {

/// Strains that there are, in Voigt order.
template <int Dim> std::vector<int> strains_in(Plane plane) {
  if (Dim == 3) return {0, 1, 2, 3, 4, 5};
  return plane == Plane::axisymmetric ? std::vector<int>{0, 1, 2, 3} : std::vector<int>{0, 1, 3};
}

/// Throws InputError for a stress that is there before anything happened, or one that turning the body would change.
template <int Dim> void require_at_rest(const Vec<9>& P, const MaterialResponse::Tangent& A, const Vec<Dim>& X) {
  const double scale = 1e-9 * A.norm();
  if (P.norm() > scale)
    throw InputError(
        fmt::format("the material at ({:.6g}) has stress where nothing has happened: that is not taken into account",
                    fmt::join(X, ", ")));
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j < i; ++j)
      if ((A.col(i + 3 * j) - A.col(j + 3 * i)).norm() > scale)
        throw InputError(fmt::format("the tangent of the material at ({:.6g}), undeformed, has stress for rotations",
                                     fmt::join(X, ", ")));
}

template <int Dim> Points<3> in_space(const Points<Dim>& X) {
  Points<3> result = Points<3>::Zero(3, X.cols());
  result.template topRows<Dim>() = X;
  return result;
}

}  // namespace

template <int Dim> Materials<Dim>::Materials(std::vector<SharedMaterial> by_region, Plane plane)
    : materials_(std::move(by_region)), plane_(plane), uniform_(materials_.size()) {
  for (const SharedMaterial& material : materials_)
    in_plane_.push_back(Dim == 2 && plane == Plane::stress ? SharedMaterial(PlaneStress(material)) : material);
  for (Index region = 0; region < num_regions(); ++region)
    if (materials_[region]->homogeneous()) uniform_[region] = ask(region, Points<Dim>::Zero(Dim, 1)).front();
}

template <int Dim> Gradient<Dim> Materials<Dim>::trace() const {
  Gradient<Dim> m = trace_direction<Dim>();
  if (Dim == 2 && plane_ != Plane::axisymmetric) m[4] = 0.0;
  return m;
}

template <int Dim>
std::vector<typename Materials<Dim>::Answer> Materials<Dim>::ask(Index region, const Points<Dim>& X) const {
  constexpr double most = 1e60;  // energies are cubes of moduli and lengths
  const Material& material = *materials_[region];
  const auto response = efree::respond(material, Deformation::none(in_space<Dim>(X), material.history_size()), true);
  const std::vector<int> there = strains_in<Dim>(plane_);
  std::vector<Answer> answers;
  answers.reserve(X.cols());
  for (Index p = 0; p < static_cast<Index>(X.cols()); ++p) {
    MaterialResponse::Tangent whole = response.tangent_at(p);
    require_at_rest<Dim>(response.P.col(p), whole, X.col(p));
    Answer answer{{}, {{}, VoigtMatrix<Dim>::Zero(), 0.0, {}, Voigt<Dim>::Zero()}};
    if constexpr (Dim == 2)
      if (plane_ == Plane::stress) {
        const auto follow = PlaneStress::strains_across(whole);
        whole = PlaneStress::condensed(whole);
        answer.stiffness.thinning = {follow(0, 0), follow(0, 4), 0.0, 0.5 * (follow(0, 1) + follow(0, 3))};
      }
    for (int a = 0; a < gradient_size<Dim>; ++a)
      for (int b = 0; b < gradient_size<Dim>; ++b) answer.A(a, b) = whole(tensor_places<Dim>[a], tensor_places<Dim>[b]);
    auto& [C, S, kappa, swelling, thinning] = answer.stiffness;
    C = voigt_of<Dim>(answer.A);
    const Matrix C_there = C(there, there);
    const Eigen::LLT<Matrix> cholesky(C_there);
    if (!answer.A.allFinite() || (answer.A - answer.A.transpose()).norm() > 1e-9 * answer.A.norm() ||
        cholesky.info() != Eigen::Success)
      throw InputError(
          fmt::format("the tangent of the material at ({:.6g}), undeformed, is not symmetric and positive definite",
                      fmt::join(X.col(p), ", ")));
    if (const double size = C.cwiseAbs().maxCoeff(); !(size > 1.0 / most && size < most))
      throw InputError(fmt::format(
          "the moduli of the material at ({:.6g}) are about {:.2g}: products of such numbers leave the range "
          "of double precision, take other units (moduli from {:.0g} to {:.0g})",
          fmt::join(X.col(p), ", "), size, 1.0 / most, most));
    // Pressure is solved for by itself: in S its compliance is what is left of entries that are larger by the
    // incompressibility.
    const Voigt<Dim> m = strain_of<Dim>(trace());
    Voigt<Dim> by_pressure = Voigt<Dim>::Zero();
    const Vector pressed = cholesky.solve(Vector(m(there)));
    by_pressure(there) = pressed;
    kappa = 1.0 / m.dot(by_pressure);
    swelling = kappa * by_pressure;
    const Matrix S_there = cholesky.solve(Matrix(Matrix::Identity(C_there.rows(), C_there.cols())));
    S(there, there) = 0.5 * (S_there + S_there.transpose());
    const VoigtMatrix<Dim> without_pressure = VoigtMatrix<Dim>::Identity() - m * swelling.transpose();
    S = without_pressure.transpose() * S * without_pressure + swelling * by_pressure.transpose();
    answers.push_back(answer);
  }
  return answers;
}

template <int Dim>
const Stiffness<Dim>& Materials<Dim>::stiffness(Index region, const Vec<Dim>& X, Stiffness<Dim>& room) const {
  if (is_uniform(region)) return uniform_[region]->stiffness;
  return room = ask(region, X).front().stiffness;
}

template <int Dim> Tangent<Dim> Materials<Dim>::part_of(const Tangent<Dim>& A, double kappa, StiffnessPart part) const {
  if (part == StiffnessPart::all) return A;
  const Gradient<Dim> m = trace();
  const Tangent<Dim> volumetric = kappa * m * m.transpose();
  return part == StiffnessPart::volumetric ? volumetric : Tangent<Dim>(A - volumetric);
}

template <int Dim> std::pair<Tangent<Dim>, double> Materials<Dim>::tangent_and_kappa(Index region, const Vec<Dim>& X,
                                                                                     StiffnessPart part) const {
  const auto in_part = [&](const Answer& answer) {
    return std::pair(part_of(answer.A, answer.stiffness.kappa, part), answer.stiffness.kappa);
  };
  return is_uniform(region) ? in_part(*uniform_[region]) : in_part(ask(region, X).front());
}

template <int Dim> PointTangents<Dim> Materials<Dim>::tangents(const Discretization<Dim>& discretization,
                                                               StiffnessPart part, double share) const {
  PointTangents<Dim> result;
  result.at = discretization.region;
  result.values.resize(num_regions());
  const auto by_region = points_by_region(discretization);
  for (Index region = 0; region < num_regions(); ++region) {
    if (is_uniform(region)) {
      result.values[region] = share * tangent(region, Vec<Dim>::Zero(), part);
      continue;
    }
    const std::vector<Index>& points = by_region[region];
    const auto answers = ask(region, discretization.points(Eigen::all, points));
    for (std::size_t k = 0; k < points.size(); ++k) {
      result.at[points[k]] = static_cast<Index>(result.values.size());
      result.values.push_back(share * part_of(answers[k].A, answers[k].stiffness.kappa, part));
    }
  }
  return result;
}

template <int Dim>
std::vector<std::vector<Index>> Materials<Dim>::points_by_region(const Discretization<Dim>& discretization) const {
  std::vector<std::vector<Index>> points(num_regions());
  for (Index K = 0; K < discretization.size(); ++K) points[discretization.region[K]].push_back(K);
  return points;
}

template <int Dim> bool Materials<Dim>::linear() const {
  return std::ranges::all_of(materials_, [](const SharedMaterial& material) { return material->linear(); });
}

template <int Dim> Index Materials<Dim>::history_size(const Discretization<Dim>& discretization) const {
  Index size = 0;
  for (const Index region : discretization.region) size += in_plane_[region]->history_size();
  return size;
}

template <int Dim> std::vector<Index> Materials<Dim>::history_places(const Discretization<Dim>& discretization) const {
  std::vector<Index> places(discretization.size());
  Index at = 0;
  const auto by_region = points_by_region(discretization);
  for (Index region = 0; region < num_regions(); ++region)
    for (const Index K : by_region[region]) {
      places[K] = at;
      at += history_size(region);
    }
  return places;
}

template <int Dim>
PointResponses<Dim> Materials<Dim>::respond(const Discretization<Dim>& discretization, const Gradients<Dim>& H,
                                            const Eigen::Ref<const Vector>& history, double dt, bool tangents) const {
  constexpr Index batch = 256;
  const Index all = discretization.size();
  require(H.cols() == all && history.size() == history_size(discretization),
          "materials: a gradient and a history for each point expected");
  PointResponses<Dim> result{
      Gradients<Dim>(gradient_size<Dim>, all), Vector(all), Vector(all), Vector(history.size()), {}};
  if (tangents) result.A.resize(all);
  const auto by_region = points_by_region(discretization);
  Index first = 0;  // of the region's history
  for (Index region = 0; region < num_regions(); ++region) {
    const Material& material = *in_plane_[region];
    const std::vector<Index>& points = by_region[region];
    const Index remembered = material.history_size(), count = static_cast<Index>(points.size());
    parallel_chunks(count, batch, [&](Index begin, Index end) {
      const Index n = end - begin, at = first + begin * remembered;
      const std::span<const Index> here(points.data() + begin, points.data() + end);
      auto deformation = Deformation::none(in_space<Dim>(discretization.points(Eigen::all, here)), remembered);
      deformation.dt = dt;
      deformation.history = history.segment(at, n * remembered).reshaped(remembered, n);
      for (Index k = 0; k < n; ++k)
        for (int a = 0; a < gradient_size<Dim>; ++a) deformation.F(tensor_places<Dim>[a], k) += H(a, here[k]);
      const MaterialResponse response = efree::respond(material, deformation, tangents);
      result.history.segment(at, n * remembered) = response.history.reshaped();
      for (Index k = 0; k < n; ++k) {
        const Index K = here[k];
        result.energy[K] = response.energy[k];
        result.dissipated[K] = response.dissipated[k];
        for (int a = 0; a < gradient_size<Dim>; ++a) {
          result.P(a, K) = response.P(tensor_places<Dim>[a], k);
          for (int b = 0; tangents && b < gradient_size<Dim>; ++b)
            result.A[K](a, b) = response.tangent_at(k)(tensor_places<Dim>[a], tensor_places<Dim>[b]);
        }
      }
    });
    first += count * remembered;
  }
  return result;
}

template <int Dim> double Materials<Dim>::incompressibility(const FineMesh<Dim>& mesh) const {
  std::vector<std::vector<Index>> cells(num_regions());  // to be asked at
  for (Index c = 0; c < mesh.num_cells(); ++c)
    if (auto& of_region = cells[mesh.region(c)]; of_region.empty() || !is_uniform(mesh.region(c)))
      of_region.push_back(c);
  double largest = 0.0;
  for (Index region = 0; region < num_regions(); ++region) {
    const auto count = static_cast<Index>(cells[region].size());
    Points<Dim> centres(Dim, count);
    for (Index k = 0; k < count; ++k) centres.col(k) = mesh.centroid(cells[region][k]);
    const Material& material = *materials_[region];
    const auto response =
        efree::respond(material, Deformation::none(in_space<Dim>(centres), material.history_size()), true);
    for (Index p = 0; p < count; ++p) largest = std::max(largest, efree::incompressibility(response.tangent_at(p)));
  }
  return largest;
}

template class Materials<2>;
template class Materials<3>;

}  // namespace efree
