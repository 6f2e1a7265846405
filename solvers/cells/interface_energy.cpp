// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/solvers/cells/internal/interface_energy.hpp"

#include "efree/assembly/kinematics.hpp"
#include "efree/core/parallel.hpp"
#include "efree/solvers/cells/internal/cell_stiffness.hpp"

#include <Eigen/Geometry>
#include <Eigen/LU>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <limits>
#include <optional>

namespace efree::internal {
namespace {

/// A material of the image, and how much of it is in each cell.
struct Phase {
  const SharedMaterial* material;
  VoigtMatrix<3> C;  ///< at the middle of the image [stress]
  double modulus;    ///< C_xxxx of it
  BoxRange cells;    ///< that may have some of it
  std::vector<float> part;
  /// Of what differs from place to place, by cell: the mean modulus of its octants, and the largest over the smallest.
  std::vector<float> mean{}, contrast{};

  double in(const std::array<Index, 3>& cell) const {
    return cells.holds(cell) ? static_cast<double>(part[cells.index(cell)]) : 0.0;
  }
  double modulus_in(const std::array<Index, 3>& cell) const {
    return mean.empty() || !cells.holds(cell) ? modulus : static_cast<double>(mean[cells.index(cell)]);
  }
  double contrast_in(const std::array<Index, 3>& cell) const {
    return contrast.empty() || !cells.holds(cell) ? 1.0 : static_cast<double>(contrast[cells.index(cell)]);
  }
};

Mat<3> tensor_of_stress(const Voigt<3>& s) {
  Mat<3> tensor;
  tensor << s[0], s[5], s[4], s[5], s[1], s[3], s[4], s[3], s[2];
  return tensor;
}
/// Of layers with normal n and these shares and stiffnesses, whose strains along the layers are those of `strain` and
/// whose traction is t: their energy density less the work of t on how they are stretched and sheared beyond `strain`.
double potential_of_layers(const std::vector<std::pair<double, VoigtMatrix<3>>>& layers, const Vec<3>& n,
                           const Voigt<3>& strain, const Vec<3>& t) {
  double potential = 0.0;
  for (const auto& [share, C] : layers) {
    // strain + sym(a n), with a so that the traction is t.
    Mat<3> acoustic;
    for (int c = 0; c < 3; ++c)
      acoustic.col(c) = tensor_of_stress(C * strain_of<3>(Mat<3>(Vec<3>::Unit(c) * n.transpose()).reshaped())) * n;
    const Vec<3> a = acoustic.inverse() * (t - tensor_of_stress(C * strain) * n);
    const Voigt<3> there = strain + strain_of<3>(Mat<3>(a * n.transpose()).reshaped());
    potential += share * (0.5 * there.dot(C * there) - t.dot(a));
  }
  return potential;
}

class MixedCells {
 public:
  MixedCells(const CellSolution& solution, const LabelImage<3>& image, const std::vector<SharedMaterial>& materials)
      : solution_(solution), voxel_(image.spacing), n_(solution.grid.cubes) {
    for (int d = 0; d < 3; ++d)
      reach_[d] = std::max<Index>(1, std::llround(0.5 * voxel_[d] / solution.grid.spacing[d]));
    const Vec<3> middle = image.in_world(
        image.origin + 0.5 * image.spacing.cwiseProduct(Vec<3>(image.size[0], image.size[1], image.size[2])));
    const std::vector<LabelCount> counts = count_labels(image);
    std::vector<Index> phase_of_label(counts.back().label + 1, -1);
    for (const LabelCount& count : counts) {
      if (count.label == 0) continue;
      const SharedMaterial& material = materials[count.label];
      phase_of_label[count.label] = static_cast<Index>(phases_.size());
      const VoigtMatrix<3> C = Materials<3>({material}, Plane::strain).stiffness(0, middle).C;
      phases_.push_back({&material, C, C(0, 0), {}, {}});
      anisotropic_ = anisotropic_ || !is_isotropic(material, middle);
    }
    if (anisotropic_) {
      const VoigtMatrix<3>& first = phases_.front().C;
      for (const Phase& phase : phases_)
        different_ = different_ || (phase.C - first).norm() > least_contrast * first.norm();
    } else {
      const auto [least, most] = std::ranges::minmax(phases_, {}, &Phase::modulus);
      different_ = most.modulus > (1.0 + least_contrast) * least.modulus;
    }
    const auto varies = [](const Phase& phase) { return !(*phase.material)->homogeneous(); };
    different_ = different_ || std::ranges::any_of(phases_, varies);
    if (!different_) return;
    const auto cells = boxes_of_groups(image, phase_of_label, static_cast<Index>(phases_.size()), n_);
    for (std::size_t label = 0; label < phase_of_label.size(); ++label) {
      const Index p = phase_of_label[label];
      if (p < 0) continue;
      phases_[p].cells = cells[p];
      phases_[p].part = BoxAverages(image, counts, ones_of({static_cast<Label>(label)}), n_).in(cells[p]);
      if (varies(phases_[p])) find_moduli(phases_[p]);
    }
    for (const Phase& phase : phases_)
      stiffness_.emplace_back(std::vector<SharedMaterial>{*phase.material}, Plane::strain);
    count_phases();
  }

  double energy() const {
    if (!different_) return 0.0;
    std::vector<double> of_layer(n_[2], 0.0);
    parallel_chunks(n_[2], 1, [&](Index begin, Index end) {
      for (Index k = begin; k < end; ++k)
        for (Index j = 0; j < n_[1]; ++j)
          for (Index i = 0; i < n_[0]; ++i)
            if (phases_in_[all_.index({i, j, k})] > 1) of_layer[k] += in_cell({i, j, k});
    });
    double sum = 0.0;
    for (const double of : of_layer) sum += of;
    return sum;
  }

 private:
  static constexpr double least_contrast = 0.02;  ///< of moduli, that matters
  static constexpr double least_part = 1e-4;      ///< of a cell, likewise
  static constexpr double most_contrast = 1.05;   ///< between octants of a cell that counts as one of one material
  static constexpr double least_aligned = 0.95;   ///< cosine between a normal and an axis of the grid

  void count_phases() {
    phases_in_.assign(all_.size(), 0);
    parallel_chunks(n_[2], 1, [&](Index k, Index) {
      for (const Phase& phase : phases_) {
        if (k < phase.cells.begin[2] || k >= phase.cells.end[2]) continue;
        for (Index j = phase.cells.begin[1]; j < phase.cells.end[1]; ++j)
          for (Index i = phase.cells.begin[0]; i < phase.cells.end[0]; ++i)
            if (phase.in({i, j, k}) > least_part)
              phases_in_[all_.index({i, j, k})] += phase.contrast_in({i, j, k}) > most_contrast ? 2 : 1;
      }
    });
  }
  /// Middle of an octant, in the world.
  Vec<3> octant(const std::array<Index, 3>& cell, int q) const {
    Vec<3> at;
    for (int d = 0; d < 3; ++d) at[d] = cell[d] + (q >> d & 1 ? 0.75 : 0.25);
    return solution_.grid.origin + solution_.axes * solution_.grid.spacing.cwiseProduct(at);
  }
  void find_moduli(Phase& phase) const {
    phase.mean.assign(phase.part.size(), 0.0F);
    phase.contrast.assign(phase.part.size(), 1.0F);
    const Material& material = **phase.material;
    const auto& [low, high] = phase.cells;
    parallel_chunks(high[2] - low[2], 1, [&](Index layer, Index) {
      for (Index j = low[1]; j < high[1]; ++j) {
        std::vector<Index> there;
        for (Index i = low[0]; i < high[0]; ++i)
          if (phase.in({i, j, low[2] + layer}) > 0.0) there.push_back(i);
        Points<3> X(3, 8 * static_cast<Index>(there.size()));
        for (std::size_t c = 0; c < there.size(); ++c)
          for (int q = 0; q < 8; ++q) X.col(8 * static_cast<Index>(c) + q) = octant({there[c], j, low[2] + layer}, q);
        if (there.empty()) continue;
        const MaterialResponse response =
            respond(material, Deformation::none(std::move(X), material.history_size()), true);
        for (std::size_t c = 0; c < there.size(); ++c) {
          double sum = 0.0, least = std::numeric_limits<double>::infinity(), most = 0.0;
          for (int q = 0; q < 8; ++q) {
            const double of = response.tangent_at(8 * static_cast<Index>(c) + q)(0, 0);
            sum += of;
            least = std::min(least, of);
            most = std::max(most, of);
          }
          const std::size_t at = phase.cells.index({there[c], j, low[2] + layer});
          phase.mean[at] = static_cast<float>(sum / 8.0);
          phase.contrast[at] = static_cast<float>(most / least);
        }
      }
    });
  }
  /// Mean modulus of the material in a cell; 0 in void.
  double modulus(const std::array<Index, 3>& at) const {
    double sum = 0.0, all = 0.0;
    for (const Phase& phase : phases_) {
      const double part = phase.in(at);
      sum += part * phase.modulus_in(at);
      all += part;
    }
    return all > 0.0 ? sum / all : 0.0;
  }
  /// How much of the material in a cell is of a phase; nothing in void.
  std::optional<double> share(const Phase& phase, const std::array<Index, 3>& at) const {
    double all = 0.0;
    for (const Phase& one : phases_) all += one.in(at);
    if (!(all > 0.0)) return {};
    return phase.in(at) / all;
  }
  /// As normal, whatever the materials are: along the steepest change of a phase's share.
  Vec<3> normal_by_shares(const std::array<Index, 3>& at) const {
    Vec<3> steepest = Vec<3>::Zero();
    const Phase* stiffer = nullptr;
    for (const Phase& phase : phases_) {
      const double here = share(phase, at).value_or(0.0);
      if (here <= least_part) continue;
      Vec<3> gradient;
      for (int d = 0; d < 3; ++d) {
        double ends[2];
        for (int s = 0; s < 2; ++s) {
          auto next = at;
          next[d] += (2 * s - 1) * reach_[d];
          ends[s] = next[d] < 0 || next[d] >= n_[d] ? here : share(phase, next).value_or(here);
        }
        gradient[d] = (ends[1] - ends[0]) / (reach_[d] * solution_.grid.spacing[d]);
      }
      if (gradient.norm() > steepest.norm()) steepest = gradient, stiffer = &phase;
    }
    if (steepest.norm() * solution_.grid.spacing.minCoeff() <= 1e-6) return Vec<3>::Zero();
    const Vec<3> along = steepest.normalized(), n = solution_.axes * along;
    const Voigt<3> stretch = strain_of<3>(Mat<3>(n * n.transpose()).reshaped());
    const auto stiffness = [&](const Phase& phase) { return stretch.dot(phase.C * stretch); };
    double of_others = 0.0, others = 0.0;
    for (const Phase& phase : phases_) {
      const double part = &phase == stiffer ? 0.0 : phase.in(at);
      if (part == 0.0) continue;
      of_others += part * stiffness(phase);
      others += part;
    }
    return stiffness(*stiffer) * others >= of_others ? along : Vec<3>(-along);
  }
  /// Towards the stiffer material, of length 1, in the image's axes; zero if there is no such direction.
  Vec<3> normal(const std::array<Index, 3>& at) const {
    if (anisotropic_) return normal_by_shares(at);
    Vec<3> gradient, bend;
    const double here = modulus(at);
    for (int d = 0; d < 3; ++d) {
      double ends[2];
      for (int s = 0; s < 2; ++s) {
        auto next = at;
        next[d] += (2 * s - 1) * reach_[d];
        ends[s] = next[d] < 0 || next[d] >= n_[d] ? 0.0 : modulus(next);
        if (ends[s] == 0.0) ends[s] = here;
      }
      const double step = reach_[d] * solution_.grid.spacing[d];
      gradient[d] = (ends[1] - ends[0]) / step;
      bend[d] = std::abs(ends[1] + ends[0] - 2.0 * here) / step;
    }
    // A layer within one row of cells has like neighbours on both sides.
    int across = 0;
    if (bend.maxCoeff(&across) > 2.0 * gradient.norm()) return Vec<3>::Unit(across);
    const double size = gradient.norm() * solution_.grid.spacing.minCoeff();
    return size > 1e-6 * here ? Vec<3>(gradient.normalized()) : Vec<3>::Zero();
  }
  Mat<3> slope(const std::array<Index, 3>& at) const {
    Mat<3> result = Mat<3>::Zero();
    const Eigen::Index row = n_[0] + 1, layer = row * (n_[1] + 1);
    for (int a = 0; a < 8; ++a) {
      const auto u =
          solution_.displacement.col(at[0] + (a & 1) + row * (at[1] + (a >> 1 & 1)) + layer * (at[2] + (a >> 2)));
      for (int d = 0; d < 3; ++d) result.col(d) += (a >> d & 1 ? 0.25 : -0.25) / solution_.grid.spacing[d] * u;
    }
    return result * solution_.axes.transpose();
  }
  double in_cell(const std::array<Index, 3>& at) const {
    double all = 0.0;
    for (const Phase& phase : phases_) all += phase.in(at);
    std::vector<std::pair<double, VoigtMatrix<3>>> layers;
    VoigtMatrix<3> mean = VoigtMatrix<3>::Zero();
    Stiffness<3> room;
    const auto add = [&](double share, const VoigtMatrix<3>& C) {
      layers.emplace_back(share, C);
      mean += share * C;
    };
    for (std::size_t p = 0; p < phases_.size(); ++p) {
      const double share = phases_[p].in(at) / all;
      if (share <= least_part) continue;
      if (phases_[p].mean.empty())
        add(share, phases_[p].C);
      else
        for (int q = 0; q < 8; ++q) add(0.125 * share, stiffness_[p].stiffness(0, octant(at, q), room).C);
    }
    const Voigt<3> strain = strain_of<3>(slope(at).reshaped());
    const Vec<3> along = normal(at);
    if (along.cwiseAbs().maxCoeff() < least_aligned) return 0.0;
    const StressBeside beside = stress_beside(at, along).value_or(StressBeside{mean * strain, false});
    const Vec<3> n = solution_.axes * along, t = tensor_of_stress(beside.stress) * n;
    const double lacking =
        all * solution_.grid.spacing.prod() *
        std::max(0.0, potential_of_layers({{1.0, mean}}, n, strain, t) - potential_of_layers(layers, n, strain, t));
    if (beside.is_soft || lacking == 0.0) return lacking;
    return lacking / (1.0 + lacking / most_in_patch(at, along, t));
  }
  /// The energy that a soft patch between stiff material releases with tractions t on its faces, in one of its cells:
  /// 1.2 t^2 a over the modulus and area, a half of its smaller width; between a penny's 0.8 and a strip's 1.6 (Sneddon
  /// 1946). Infinite where it reaches the image's frame or void on all sides.
  double most_in_patch(const std::array<Index, 3>& at, const Vec<3>& normal, const Vec<3>& t) const {
    constexpr Index farthest = 32;  // cells
    const double here = modulus(at);
    double narrowest = std::numeric_limits<double>::infinity(), stiffest = here;
    Index across = 0;
    normal.cwiseAbs().maxCoeff(&across);
    for (Index d = 0; d < 3; ++d) {
      Index width = 1, ends = 0;
      for (const Index side : {-1, 1}) {
        auto next = at;
        for (Index step = 1; d != across && step <= farthest; ++step, ++width) {
          next[d] += side;
          const double there = next[d] < 0 || next[d] >= n_[d] ? 0.0 : modulus(next);
          if (there == 0.0) break;
          if (there < (1.0 + least_contrast) * here || phases_in_[all_.index(next)] > 1) continue;
          stiffest = std::max(stiffest, there);
          ++ends;
          break;
        }
      }
      if (ends == 1) width *= 2;  // one that ends at the frame, or in void, goes on as its mirror image
      if (ends > 0) narrowest = std::min(narrowest, width * solution_.grid.spacing[d]);
    }
    return 0.6 * narrowest * t.squaredNorm() / stiffest * solution_.grid.spacing.prod() /
           solution_.grid.spacing[across];
  }
  struct StressBeside {
    Voigt<3> stress;
    bool is_soft;  ///< of material softer than the mixed cell
  };
  /// The stress in the nearest cell of one material along the normal, on the soft side if there is one: that of a mixed
  /// cell, which is strained like its soft neighbours, would be far too large.
  std::optional<StressBeside> stress_beside(const std::array<Index, 3>& at, const Vec<3>& normal) const {
    // Cells smaller than voxels are mixed wherever the part of a voxel is that the boundary crosses.
    const int farthest = static_cast<int>(
        std::ceil(std::max(3.0, 1.5 * (voxel_.array() / solution_.grid.spacing.array()).maxCoeff())));  // cells
    for (const double side : {-1.0, 1.0})
      for (int step = 1; step <= farthest; ++step) {
        const Vec<3> way =
            (side * step * solution_.grid.spacing.minCoeff() * normal).cwiseQuotient(solution_.grid.spacing);
        std::array<Index, 3> there;
        bool inside = true;
        for (int d = 0; d < 3; ++d) {
          there[d] = static_cast<Index>(std::floor(at[d] + 0.5 + way[d]));
          inside = inside && there[d] >= 0 && there[d] < n_[d];
        }
        if (!inside || there == at) continue;
        double all = 0.0;
        const Phase* most = nullptr;
        for (const Phase& phase : phases_) {
          all += phase.in(there);
          if (most == nullptr || phase.in(there) > most->in(there)) most = &phase;
        }
        if (all < 0.5 || most->in(there) < (1.0 - least_part) * all || most->contrast_in(there) > most_contrast)
          continue;
        const Vec<3> x = solution_.grid.origin + solution_.axes * solution_.grid.spacing.cwiseProduct(Vec<3>(
                                                                      there[0] + 0.5, there[1] + 0.5, there[2] + 0.5));
        Stiffness<3> room;
        return StressBeside{
            stiffness_[most - phases_.data()].stiffness(0, x, room).C * strain_of<3>(slope(there).reshaped()),
            modulus(there) < modulus(at)};
      }
    return {};
  }

  const CellSolution& solution_;
  Vec<3> voxel_;                  ///< edges [length]
  std::array<Index, 3> reach_{};  ///< cells to neighbours whose shares differ, as these are of eighths of voxels
  std::array<Index, 3> n_;
  BoxRange all_{{0, 0, 0}, n_};
  std::vector<Phase> phases_;
  std::vector<Materials<3>> stiffness_;  ///< by phase
  std::vector<std::uint8_t> phases_in_;  ///< by cell, how many
  bool different_ = false, anisotropic_ = false;
};

}  // namespace

double interface_energy(const CellSolution& solution, const LabelImage<3>& image,
                        const std::vector<SharedMaterial>& materials) {
  const auto is_one = [](const SharedMaterial& one) { return bool(one); };
  const auto varies = [](const SharedMaterial& one) { return one && !one->homogeneous(); };
  if (std::ranges::count_if(materials, is_one) < 2 && std::ranges::none_of(materials, varies)) return 0.0;
  return MixedCells(solution, image, materials).energy();
}

}  // namespace efree::internal
