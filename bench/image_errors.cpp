// SPDX-License-Identifier: GPL-3.0-or-later
/// Images on cells: what grids say of their errors against what these are, in the energy norm and at probes.
///
/// usage: bench_image_errors [blocks of each kind, 40] [edge of a cell in voxels, 2]
///
/// Blocks of 16 to 26 voxels with one to four balls and boxes of 1.5 to 5 voxels, or with layers, on three planes that
/// slide: pressure in pores, or a pull at the top of a block with pores, with inclusions 1 : 2 to 1 : 100 and with
/// layers 1 : 2 to 1 : 1000 along an axis or tilted. Against cells of a quarter of a voxel. Prints for each kind how
/// many errors there are (in the energy norm above 3 %, of probes above 1 %), the parts of these that are stated as
/// half to twice, and as less than half, the smallest ratio, its median, and the largest true error where less than 10
/// % (of probes 2 %) is stated.
#include "efree/materials/linear_elastic.hpp"
#include "efree/solvers/cells/cell_errors.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <functional>
#include <memory>
#include <random>
#include <utility>
#include <vector>

using namespace efree;

namespace {

enum class Kind { pressure, pores, inclusions, layers, tilted };

class Scene {
 public:
  Scene(Kind kind, std::mt19937& random) : random_(random) {
    auto image = std::make_shared<LabelImage<3>>();
    for (Index& n : image->size) n = whole(16, 26);
    const auto label = kind < Kind::layers ? grains(kind, image->size) : layers(kind);
    for (Index k = 0; k < image->size[2]; ++k)
      for (Index j = 0; j < image->size[1]; ++j)
        for (Index i = 0; i < image->size[0]; ++i) image->labels.push_back(label(Vec<3>(i + 0.5, j + 0.5, k + 0.5)));
    const double contrast = std::pow(10.0, real(0.3, kind < Kind::layers ? 2.0 : 3.0));
    materials_ = {{}, SharedMaterial(LinearElastic(1.0, 0.3)), SharedMaterial(LinearElastic(contrast, 0.2))};
    const char* loaded = kind == Kind::pressure ? "pores" : "top";
    loads_.tractions = {pressure<3>(loaded, [kind](const Vec<3>&) { return kind == Kind::pressure ? 1.0 : -1.0; })};
    image_ = image;
  }
  const LabelImage<3>& image() const { return *image_; }
  bool has_void() const { return std::ranges::find(image_->labels, 0) != image_->labels.end(); }
  CellSolution solve(double size, double tolerance) const {
    return solve_on_cells(*image_, materials_,
                          {symmetry_plane<3>("left"), symmetry_plane<3>("front"), symmetry_plane<3>("bottom")}, loads_,
                          {.size = size, .tolerance = tolerance});
  }
  /// At a corner, two sides, and beside the first grain, as far as there is material.
  std::vector<Vec<3>> probes() const {
    const Vec<3> size(image_->size[0], image_->size[1], image_->size[2]), half = 0.5 * size;
    std::vector<Vec<3>> all{size, {size[0], half[1], half[2]}, {half[0], half[1], size[2]}, beside_};
    for (Vec<3>& x : all) x = x.cwiseMax(0.01).cwiseMin(size - Vec<3>::Constant(0.01));
    std::erase_if(all, [&](const Vec<3>& x) {
      return image_->labels[image_->index(
                 {static_cast<Index>(x[0]), static_cast<Index>(x[1]), static_cast<Index>(x[2])})] == 0;
    });
    return all;
  }

 private:
  double real(double from, double to) { return std::uniform_real_distribution<double>(from, to)(random_); }
  Index whole(Index from, Index to) { return std::uniform_int_distribution<Index>(from, to)(random_); }

  std::function<Label(const Vec<3>&)> grains(Kind kind, const std::array<Index, 3>& size) {
    struct Grain {
      Vec<3> middle, radii;
      bool is_box;
    };
    std::vector<Grain> all(static_cast<std::size_t>(whole(1, 4)));
    for (Grain& grain : all) {
      for (int d = 0; d < 3; ++d) grain.middle[d] = real(5.0, static_cast<double>(size[d]) - 4.0);
      for (double& radius : grain.radii) radius = real(1.5, 4.0) * real(0.8, 1.3);
      grain.is_box = whole(0, 1) == 1;
    }
    beside_ = all.front().middle + Vec<3>(0.0, 0.0, all.front().radii[2] + 0.5);
    return [all, inside = static_cast<Label>(kind == Kind::inclusions ? 2 : 0)](const Vec<3>& x) -> Label {
      for (const Grain& grain : all) {
        const Vec<3> off = (x - grain.middle).cwiseQuotient(grain.radii);
        if ((grain.is_box ? off.cwiseAbs().maxCoeff() : off.norm()) < 1.0) return inside;
      }
      return 1;
    };
  }
  std::function<Label(const Vec<3>&)> layers(Kind kind) {
    const Vec<3> across = kind == Kind::layers ? Vec<3>(Vec<3>::Unit(whole(0, 2)))
                                               : Vec<3>(real(-1, 1), real(-1, 1), real(-1, 1)).normalized();
    const double thickness = real(3.0, 9.0), first = real(0.0, 5.0);
    beside_ = Vec<3>::Constant(8.0);
    return [=](const Vec<3>& x) -> Label {
      return static_cast<Label>(1 + (static_cast<int>(std::floor((across.dot(x) + first) / thickness + 100.0)) % 2));
    };
  }

  std::mt19937& random_;
  std::shared_ptr<const LabelImage<3>> image_;
  std::vector<SharedMaterial> materials_;
  Loads<3> loads_;
  Vec<3> beside_;
};

/// Errors that are stated and true ones.
class Row {
 public:
  Row(double least, double warned) : least_(least), warned_(warned) {}
  void add(double stated, double truth) {
    if (stated < warned_) unwarned_ = std::max(unwarned_, truth);
    if (truth > least_) ratios_.push_back(stated / truth);
  }
  void print(const char* of) {
    if (ratios_.empty()) return;
    std::ranges::sort(ratios_);
    const auto part = [&](double from, double to) {
      const auto in = [=](double ratio) { return ratio >= from && ratio <= to; };
      return 100.0 * static_cast<double>(std::ranges::count_if(ratios_, in)) / static_cast<double>(ratios_.size());
    };
    std::printf("  %-8s %4zu  half to twice %3.0f %%  less %3.0f %%  least %.2f  median %.2f  unwarned %.1f %%\n", of,
                ratios_.size(), part(0.5, 2.0), part(0.0, 0.5), ratios_.front(), ratios_[ratios_.size() / 2],
                100.0 * unwarned_);
  }

 private:
  double least_, warned_, unwarned_ = 0.0;
  std::vector<double> ratios_;
};

void compare(const Scene& scene, double size, Row& energy, Row& probes) {
  const CellSolution found = scene.solve(size, CellOptions{}.tolerance), fine = scene.solve(0.25, 1e-4);
  energy.add(std::hypot(found.grid_error, found.interface_error),
             std::sqrt(std::abs(found.finest().strain_energy / fine.extrapolated_energy - 1.0)));
  for (const Vec<3>& x : scene.probes()) {
    // Fine cells leave half of what the last step changed.
    const Vec<3> last = displacement_at(fine, 0, x), exact = last + 0.5 * (last - displacement_at(fine, 1, x));
    probes.add(displacement_error_at(found, x).norm() / exact.norm(),
               (displacement_at(found, 0, x) - exact).norm() / exact.norm());
  }
}

}  // namespace

int main(int argc, char** argv) {
  const int blocks = argc > 1 ? std::atoi(argv[1]) : 40;
  const double size = argc > 2 ? std::atof(argv[2]) : 2.0;
  for (const auto& [kind, name] : {std::pair{Kind::pressure, "pressure in pores"},
                                   {Kind::pores, "pores"},
                                   {Kind::inclusions, "inclusions"},
                                   {Kind::layers, "layers"},
                                   {Kind::tilted, "tilted layers"}}) {
    std::mt19937 random(static_cast<unsigned>(kind) + 7);
    Row energy(0.03, 0.1), probes(0.01, 0.02);
    for (int b = 0; b < blocks; ++b) {
      Scene scene(kind, random);
      if (kind == Kind::pressure && !scene.has_void()) continue;
      compare(scene, size, energy, probes);
    }
    std::printf("%s\n", name);
    energy.print("energy");
    probes.print("probes");
  }
}
