// SPDX-License-Identifier: GPL-3.0-or-later
// bench_lme [POINTS]: how often Newton's method finds local maximum entropy functions, with line search and without
// (SAND2020-9716, figure 5-5). Prints CSV: gamma, where, and for each the share of points found and the mean number of
// iterations.
//
// Nodes are a lattice of 5 x 5 x 5 in a unit cube, each moved by up to a fifth of the spacing (along the faces, if it
// is on one), and one more exactly in the middle between two of them; points are anywhere in the cube, or nearer than
// 1e-2 to 1e-8 to a face, an edge or a corner. Multipliers start from zero.

#include "efree/basis/lme.hpp"

#include <array>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <random>

namespace efree {
namespace {

constexpr int across = 5;
constexpr double spacing = 1.0 / (across - 1);

class Draw {
 public:
  /// Between 0 and 1.
  double unit() { return static_cast<double>(random_() >> 11) * 0x1p-53; }
  int below(int n) { return static_cast<int>(unit() * n); }

 private:
  std::mt19937_64 random_{1};
};

Points<3> nodes(Draw& draw) {
  Points<3> result(3, across * across * across + 1);
  Index a = 0;
  for (int i = 0; i < across; ++i)
    for (int j = 0; j < across; ++j)
      for (int k = 0; k < across; ++k, ++a) {
        const int at[3] = {i, j, k};
        for (int d = 0; d < 3; ++d) {
          const bool on_face = at[d] == 0 || at[d] == across - 1;
          result(d, a) = spacing * (at[d] + (on_face ? 0.0 : 0.4 * draw.unit() - 0.2));
        }
      }
  const int one = draw.below(a), other = one + 1 < a ? one + 1 : one - 1;
  result.col(a) = 0.5 * (result.col(one) + result.col(other));
  return result;
}

/// Anywhere, or near that many faces at once.
Vec<3> point(Draw& draw, int faces) {
  Vec<3> at(draw.unit(), draw.unit(), draw.unit());
  const int first = draw.below(3);
  for (int k = 0; k < faces; ++k) {
    const double distance = std::pow(10.0, -2.0 - 6.0 * draw.unit());
    at[(first + k) % 3] = draw.unit() < 0.5 ? distance : 1.0 - distance;
  }
  return at;
}

}  // namespace
}  // namespace efree

int main(int argc, char** argv) {
  using namespace efree;
  const int count = argc > 1 ? std::atoi(argv[1]) : 20000;
  constexpr std::array where{"anywhere", "face", "edge", "corner"};
  std::puts("gamma,where,found_with,iterations_with,found_without,iterations_without");
  for (const double gamma : {0.6, 0.8, 1.2, 1.8, 2.5, 3.5, 4.8, 6.0})
    for (int faces = 0; faces < 4; ++faces) {
      Draw draw;
      std::array<int, 2> found{}, iterations{};
      for (int k = 0; k < count; ++k) {
        static Points<3> x;
        if (k % 100 == 0) x = nodes(draw);
        const Vec<3> at = point(draw, faces);
        for (const bool search : {true, false}) {
          LmeFunctions<3> functions({.gamma = gamma, .max_iterations = 100, .line_search = search});
          for (Index a = 0; a < x.cols(); ++a) functions.add(x.col(a) - at);
          Vec<3> lambda = Vec<3>::Zero();
          const bool good =
              functions.find(gamma / (spacing * spacing) * Mat<3>::Identity(), lambda) == LmeStatus::found;
          found[search ? 0 : 1] += good;
          iterations[search ? 0 : 1] += functions.iterations();
        }
      }
      std::printf("%g,%s,%.5f,%.2f,%.5f,%.2f\n", gamma, where[faces], static_cast<double>(found[0]) / count,
                  static_cast<double>(iterations[0]) / count, static_cast<double>(found[1]) / count,
                  static_cast<double>(iterations[1]) / count);
      std::fflush(stdout);
    }
}
