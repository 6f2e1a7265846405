// SPDX-License-Identifier: GPL-3.0-or-later
/// Effective tensors against closed forms and series, by resolution, and what six loads cost: bench_effective [cost N].
#include "efree/tests/solvers/labelled_image.hpp"

#include "efree/core/internal/clock.hpp"
#include "efree/materials/linear_elastic.hpp"
#include "efree/solvers/cells/cell_solver.hpp"
#include "efree/solvers/cells/effective.hpp"

#include <fmt/format.h>
#include <cmath>
#include <functional>
#include <numbers>
#include <string>

using namespace efree;

namespace {

using test::image_of;

LabelImage<3> pore_of(Index n) {
  const double radius = n * std::cbrt(0.75 * 0.2 / std::numbers::pi);
  return image_of({n, n, n},
                  [=](const Vec<3>& x) -> Label { return (x - Vec<3>::Constant(0.5 * n)).norm() >= radius; });
}
LabelImage<3> gyroid_of(Index n) {
  const double a = 2.0 * std::numbers::pi / n;
  return image_of({n, n, n}, [=](const Vec<3>& x) -> Label {
    double sum = 0.0;
    for (int d = 0; d < 3; ++d) sum += std::sin(a * x[d]) * std::cos(a * x[(d + 1) % 3]);
    return sum < 0.0;
  });
}
std::vector<SharedMaterial> materials() {
  return {SharedMaterial{}, SharedMaterial(LinearElastic(10.0, 0.3)), SharedMaterial(LinearElastic(1.37, 0.17))};
}

void show(const std::string& name, const EffectiveTensor& found, double seconds) {
  const Matrix &C = found.tensor, &D = found.extrapolated;
  const Index last = C.rows() - 1;
  fmt::print(
      "{:<28} {:>8} cells {:>3} its  {:>10.6f} {:>10.6f} {:>10.6f}  extrapolated {:>10.6f} {:>10.6f} {:>10.6f}  "
      "error {:.1e}, asymmetry {:.0e}, {:.2f} s\n",
      name, found.finest().cells, found.finest().iterations, C(0, 0), C(0, 1), C(last, last), D(0, 0), D(0, 1),
      D(last, last), found.grid_error, found.asymmetry, seconds);
}
template <class Work> void timed(const std::string& name, const Work& work) {
  const internal::Stopwatch seconds;
  const EffectiveTensor found = work();
  show(name, found, seconds());
}

void checkerboards() {
  fmt::print("checkerboard, conductivities 1 and 10: {:.6f}\n", std::sqrt(10.0));
  for (const Index n : {32, 64, 128, 512}) {
    const auto image =
        image_of({n, n, 1}, [=](const Vec<3>& x) -> Label { return (x[0] < 0.5 * n) == (x[1] < 0.5 * n) ? 1 : 2; });
    timed(fmt::format("{} x {} voxels", n, n), [&] {
      return effective_conductivity(image, {0.0, 1.0, 10.0}, {.size = 1.0, .smooth = false});
    });
  }
}

void resolutions() {
  for (const Index n : {16, 24, 32, 48, 64, 96}) {
    timed(fmt::format("pore, stiffness, {}^3", n), [&] { return effective_stiffness(pore_of(n), materials()); });
    timed(fmt::format("pore, conductivity, {}^3", n), [&] { return effective_conductivity(pore_of(n), {0.0, 1.0}); });
    timed(fmt::format("gyroid, stiffness, {}^3", n), [&] { return effective_stiffness(gyroid_of(n), materials()); });
  }
}

/// CPU seconds of one load, by solve_on_cells and here, and of six.
void costs(Index n) {
  const auto image = pore_of(n);
  const auto seconds = [](const auto& work) {
    const double begin = internal::process_cpu_seconds();
    work();
    return internal::process_cpu_seconds() - begin;
  };
  const double before = seconds([&] {
    solve_on_cells(image, materials(),
                   {symmetry_plane<3>("left"),
                    symmetry_plane<3>("front"),
                    symmetry_plane<3>("bottom"),
                    {"top", {}, [](const Vec<3>&) { return 1.0; }}},
                   {}, {.size = 1.0});
  });
  const double one = seconds([&] { effective_stiffness(image, materials(), {.size = 1.0, .loads = 1}); });
  const double six = seconds([&] { effective_stiffness(image, materials(), {.size = 1.0}); });
  fmt::print(
      "{}^3 voxels, CPU seconds: solve_on_cells {:.2f}, one load {:.2f}, six loads {:.2f}: {:.2f} and {:.2f} times\n",
      n, before, one, six, six / before, six / one);
}

}  // namespace

int main(int argc, char** argv) {
  if (argc == 3 && std::string(argv[1]) == "cost") {
    costs(std::stoi(argv[2]));
    return 0;
  }
  checkerboards();
  resolutions();
  for (const Index n : {32, 64, 96}) costs(n);
  return 0;
}
