// SPDX-License-Identifier: GPL-3.0-or-later
/// Voxel finite elements: trilinear hexahedra on a lattice, conjugate gradients without a matrix, preconditioned by
/// geometric multigrid (as in Flaig & Arbenz 2011; Arbenz, van Lenthe, Mennel, Mueller, Sala 2008). Coarse lattices
/// have the mean modulus of the eight cells below them and are discretised anew; the smoother is a Chebyshev polynomial
/// over the diagonal (Adams, Brezina, Hu, Tuminaro 2003). The preconditioner is in single precision, the rest in
/// double. One thread.
///
///   voxel_multigrid block [voxels per cell = 1] [tolerance = 1e-3]
///   voxel_multigrid gyroid [cell size = 1] [tolerance = 1e-3]
///
/// A cell's modulus is its solid fraction: 0 or 1 on the block with one voxel to a cell, grey otherwise. Iterations end
/// when the preconditioned residual, which is the error in the energy norm but for a factor near one, has fallen by
/// the tolerance; the modulus is then off by about its square.
#include "problem.hpp"

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <algorithm>
#include <array>
#include <cstdlib>
#include <cstring>
#include <stdexcept>
#include <string>
#include <vector>

namespace {

constexpr double poisson = 0.3, strain = 0.01;
constexpr int corners = 8, local = 3 * corners;
using Stiffness = Eigen::Matrix<double, local, local>;

/// Of the unit cube with E = 1: local unknown 8 c + a is component c at corner a = x + 2 y + 4 z.
Stiffness unit_stiffness() {
  const double lambda = poisson / ((1 + poisson) * (1 - 2 * poisson)), mu = 0.5 / (1 + poisson);
  const double g = 0.5 / std::sqrt(3.0);
  Stiffness K = Stiffness::Zero();
  for (int q = 0; q < 8; ++q) {
    const std::array<double, 3> x{0.5 + (q & 1 ? g : -g), 0.5 + (q & 2 ? g : -g), 0.5 + (q & 4 ? g : -g)};
    Eigen::Matrix<double, 3, corners> dN;
    for (int a = 0; a < corners; ++a)
      for (int d = 0; d < 3; ++d) {
        dN(d, a) = 1.0;
        for (int e = 0; e < 3; ++e) {
          const bool far = a >> e & 1;
          dN(d, a) *= e == d ? (far ? 1.0 : -1.0) : (far ? x[e] : 1.0 - x[e]);
        }
      }
    for (int c = 0; c < 3; ++c)
      for (int d = 0; d < 3; ++d)
        for (int a = 0; a < corners; ++a)
          for (int b = 0; b < corners; ++b) {
            double value = lambda * dN(c, a) * dN(d, b) + mu * dN(d, a) * dN(c, b);
            if (c == d) value += mu * dN.col(a).dot(dN.col(b));
            K(corners * c + a, corners * d + b) += value / 8.0;
          }
  }
  return K;
}

/// n x n x n cells. Fields hold three components one after the other, nodes with x fastest.
struct Level {
  int n;
  std::vector<float> modulus;  ///< by cell times its edge; rows padded to `row` cells
  int row;
  std::vector<float> inverse_diagonal;  ///< by node, the same for all components; 0 where there is nothing

  static constexpr int lanes = 16;
  Level(int cells, const std::vector<float>& density, double edge) : n(cells), row((n + lanes - 1) / lanes * lanes) {
    modulus.assign(static_cast<std::size_t>(row) * n * n, 0.0F);
    for (int k = 0; k < n; ++k)
      for (int j = 0; j < n; ++j)
        for (int i = 0; i < n; ++i)
          modulus[cell(i, j, k)] = static_cast<float>(edge * density[i + static_cast<std::size_t>(n) * (j + n * k)]);
  }
  std::size_t cell(int i, int j, int k) const {
    return i + static_cast<std::size_t>(row) * (j + static_cast<std::size_t>(n) * k);
  }
  std::size_t node(int i, int j, int k) const {
    return i + static_cast<std::size_t>(n + 1) * (j + static_cast<std::size_t>(n + 1) * k);
  }
  std::size_t nodes() const { return node(n, n, n) + 1; }
  /// Rows are read and written (by nothing added) up to `lanes` beyond their end.
  std::size_t size() const { return 3 * nodes() + 2 * lanes; }

  /// Components that are held: x on the left, y in front, z below and above.
  template <class F> void for_held(const F& f) const {
    for (int b = 0; b <= n; ++b)
      for (int a = 0; a <= n; ++a) {
        f(node(0, a, b));
        f(nodes() + node(a, 0, b));
        f(2 * nodes() + node(a, b, 0));
        f(2 * nodes() + node(a, b, n));
      }
  }
};

/// f = K u, without boundary conditions.
template <class T> void apply(const Level& level, const Stiffness& unit, const T* u, T* f) {
  constexpr int W = Level::lanes, block = 6;
  using Lane [[gnu::vector_size(W * sizeof(T))]] = T;
  alignas(64) static std::array<std::array<T, local>, local> K;  // columns first: K[c][r]
  for (int r = 0; r < local; ++r)
    for (int c = 0; c < local; ++c) K[c][r] = static_cast<T>(unit(r, c));
  std::fill(f, f + level.size(), T(0));
  const auto load = [](const T* from) {
    Lane v;
    std::memcpy(&v, from, sizeof v);
    return v;
  };
  for (int k = 0; k < level.n; ++k)
    for (int j = 0; j < level.n; ++j)
      for (int i = 0; i < level.n; i += W) {
        const float* modulus = level.modulus.data() + level.cell(i, j, k);
        Lane scale;
        bool empty = true;
        for (int w = 0; w < W; ++w) {
          scale[w] = static_cast<T>(modulus[w]);
          empty = empty && modulus[w] == 0.0F;
        }
        if (empty) continue;
        std::array<std::size_t, local> at;
        Lane in[local], out[local];
        for (int c = 0; c < 3; ++c)
          for (int a = 0; a < corners; ++a) {
            at[corners * c + a] = c * level.nodes() + level.node(i + (a & 1), j + (a >> 1 & 1), k + (a >> 2));
            in[corners * c + a] = load(u + at[corners * c + a]);
          }
        for (int r = 0; r < local; r += block) {
          Lane sum[block] = {};
          for (int c = 0; c < local; ++c)
            for (int b = 0; b < block; ++b) sum[b] += K[c][r + b] * in[c];
          for (int b = 0; b < block; ++b) out[r + b] = sum[b] * scale;
        }
        for (int r = 0; r < local; ++r) {
          const Lane v = load(f + at[r]) + out[r];
          std::memcpy(f + at[r], &v, sizeof v);
        }
      }
  level.for_held([&](std::size_t dof) { f[dof] = T(0); });
}

/// A V-cycle.
class Multigrid {
 public:
  Multigrid(std::vector<Level>& levels, const Stiffness& unit, int degree)
      : levels_(levels), unit_(unit), degree_(degree) {
    // No assembled matrix has a larger eigenvalue over its diagonal than its elements.
    const Eigen::VectorXd diagonal = unit.diagonal();
    const Eigen::VectorXd root = diagonal.cwiseSqrt().cwiseInverse();
    largest_ =
        Eigen::SelfAdjointEigenSolver<Stiffness>(root.asDiagonal() * unit * root.asDiagonal()).eigenvalues().maxCoeff();
    for (Level& level : levels_) {
      std::vector<float>& d = level.inverse_diagonal;
      d.assign(level.nodes(), 0.0F);
      for (int k = 0; k < level.n; ++k)
        for (int j = 0; j < level.n; ++j)
          for (int i = 0; i < level.n; ++i)
            for (int a = 0; a < corners; ++a)
              d[level.node(i + (a & 1), j + (a >> 1 & 1), k + (a >> 2))] +=
                  static_cast<float>(unit(a, a)) * level.modulus[level.cell(i, j, k)];
      for (float& value : d) value = value > 0.0F ? 1.0F / value : 0.0F;
      work_.push_back({});
      const std::size_t size = level.size();
      // Of the finest level the right-hand side and the answer belong to the caller.
      if (work_.size() > 1) work_.back().b.assign(size, 0.0F), work_.back().x.assign(size, 0.0F);
      work_.back().d.assign(size, 0.0F);
      work_.back().r.assign(size, 0.0F);
    }
    factor_coarsest();
  }

  /// x = an approximate inverse times b.
  void operator()(const float* b, float* x) { cycle(0, b, x); }

 private:
  struct Work {
    std::vector<float> b, x, d, r;
  };

  void factor_coarsest() {
    const Level& level = levels_.back();
    const auto size = static_cast<Eigen::Index>(3 * level.nodes());
    Eigen::MatrixXd K(size, size);
    std::vector<double> e(level.size(), 0.0), column(level.size());
    std::vector<char> held(level.size(), 0);
    level.for_held([&](std::size_t dof) { held[dof] = 1; });
    for (Eigen::Index c = 0; c < size; ++c) {
      e[c] = held[c] ? 0.0 : 1.0;
      apply(level, unit_, e.data(), column.data());
      e[c] = 0.0;
      K.col(c) = Eigen::Map<Eigen::VectorXd>(column.data(), size);
      if (held[c] || level.inverse_diagonal[c % level.nodes()] == 0.0F) K(c, c) = 1.0;
    }
    coarsest_.compute(K);
    if (coarsest_.info() != Eigen::Success) throw std::runtime_error("the coarsest level cannot be factored");
  }

  /// Improves x by a polynomial of b - K x; `zero`: x is 0 and need not be set.
  void smooth(std::size_t l, const float* b, float* x, bool zero) {
    const Level& level = levels_[l];
    const std::size_t nodes = level.nodes();
    float *d = work_[l].d.data(), *r = work_[l].r.data();
    const float* inverse = level.inverse_diagonal.data();
    const double high = 1.05 * largest_, low = high / range, centre = 0.5 * (high + low), half = 0.5 * (high - low);
    double rho = half / centre;
    for (int step = 0; step < degree_; ++step) {
      float keep = 0.0F, take = static_cast<float>(1.0 / centre);
      if (step > 0) {
        const double next = 1.0 / (2.0 * centre / half - rho);
        keep = static_cast<float>(next * rho);
        take = static_cast<float>(2.0 * next / half);
        rho = next;
      }
      const bool first = zero && step == 0;
      if (!first) apply(level, unit_, x, r);
      for (int c = 0; c < 3; ++c) {
        const std::size_t begin = c * nodes;
        for (std::size_t i = 0; i < nodes; ++i) {
          const std::size_t dof = begin + i;
          const float residual = first ? b[dof] : b[dof] - r[dof];
          d[dof] = (step > 0 ? keep * d[dof] : 0.0F) + take * inverse[i] * residual;
          x[dof] = first ? d[dof] : x[dof] + d[dof];
        }
      }
    }
  }

  void cycle(std::size_t l, const float* b, float* x) {
    const Level& fine = levels_[l];
    if (l + 1 == levels_.size()) {
      const auto size = static_cast<Eigen::Index>(3 * fine.nodes());
      Eigen::Map<Eigen::VectorXf>(x, size) =
          coarsest_.solve(Eigen::Map<const Eigen::VectorXf>(b, size).cast<double>()).cast<float>();
      return;
    }
    smooth(l, b, x, true);
    float* r = work_[l].r.data();
    apply(fine, unit_, x, r);
    for (std::size_t dof = 0; dof < 3 * fine.nodes(); ++dof) r[dof] = b[dof] - r[dof];
    restrict_to(levels_[l + 1], fine, r, work_[l + 1].b.data());
    cycle(l + 1, work_[l + 1].b.data(), work_[l + 1].x.data());
    prolong(levels_[l + 1], fine, work_[l + 1].x.data(), x);
    smooth(l, b, x, false);
  }

  /// coarse = P^T fine with trilinear P.
  static void restrict_to(const Level& coarse, const Level& fine, const float* from, float* to) {
    for (int c = 0; c < 3; ++c)
      for (int k = 0; k <= coarse.n; ++k)
        for (int j = 0; j <= coarse.n; ++j)
          for (int i = 0; i <= coarse.n; ++i) {
            float sum = 0.0F;
            for (int dk = k > 0 ? -1 : 0; dk <= (k < coarse.n ? 1 : 0); ++dk)
              for (int dj = j > 0 ? -1 : 0; dj <= (j < coarse.n ? 1 : 0); ++dj) {
                const float* row = from + c * fine.nodes() + fine.node(2 * i, 2 * j + dj, 2 * k + dk);
                float line = row[0];
                if (i > 0) line += 0.5F * row[-1];
                if (i < coarse.n) line += 0.5F * row[1];
                sum += (dk ? 0.5F : 1.0F) * (dj ? 0.5F : 1.0F) * line;
              }
            const std::size_t node = coarse.node(i, j, k);
            to[c * coarse.nodes() + node] = coarse.inverse_diagonal[node] > 0.0F ? sum : 0.0F;
          }
    coarse.for_held([&](std::size_t dof) { to[dof] = 0.0F; });
  }

  /// fine += P coarse, where there is something.
  static void prolong(const Level& coarse, const Level& fine, const float* from, float* to) {
    std::vector<float> line(coarse.n + 1);
    for (int c = 0; c < 3; ++c)
      for (int k = 0; k <= fine.n; ++k)
        for (int j = 0; j <= fine.n; ++j) {
          const float* base = from + c * coarse.nodes();
          const std::array<const float*, 4> rows{
              base + coarse.node(0, j / 2, k / 2), base + coarse.node(0, (j + 1) / 2, k / 2),
              base + coarse.node(0, j / 2, (k + 1) / 2), base + coarse.node(0, (j + 1) / 2, (k + 1) / 2)};
          for (int i = 0; i <= coarse.n; ++i) line[i] = 0.25F * (rows[0][i] + rows[1][i] + rows[2][i] + rows[3][i]);
          const std::size_t node = fine.node(0, j, k);
          float* out = to + c * fine.nodes() + node;
          for (int i = 0; i <= fine.n; ++i)
            if (fine.inverse_diagonal[node + i] > 0.0F)
              out[i] += i % 2 ? 0.5F * (line[i / 2] + line[i / 2 + 1]) : line[i / 2];
        }
    fine.for_held([&](std::size_t dof) { to[dof] = 0.0F; });
  }

  static constexpr double range = 8.0;  ///< part of the spectrum that the smoother works on
  std::vector<Level>& levels_;
  const Stiffness& unit_;
  int degree_;
  double largest_;
  std::vector<Work> work_;
  Eigen::LDLT<Eigen::MatrixXd> coarsest_;
};

double dot(const std::vector<double>& a, const auto& b) {
  double sum = 0.0;
  for (std::size_t i = 0; i < a.size(); ++i) sum += a[i] * b[i];
  return sum;
}

void run(const std::string& name, int n, std::vector<float> density, double length, double reference,
         double tolerance) {
  const double start = peers::cpu_seconds();
  const long cells = std::count_if(density.begin(), density.end(), [](float d) { return d > 0.0F; });
  const Stiffness unit = unit_stiffness();
  std::vector<Level> levels;
  levels.emplace_back(n, density, length / n);
  while (levels.back().n % 2 == 0 && levels.back().n > 4) {
    const int m = levels.back().n / 2;
    std::vector<float> coarse(static_cast<std::size_t>(m) * m * m, 0.0F);
    for (int k = 0; k < 2 * m; ++k)
      for (int j = 0; j < 2 * m; ++j)
        for (int i = 0; i < 2 * m; ++i)
          coarse[i / 2 + static_cast<std::size_t>(m) * (j / 2 + m * (k / 2))] +=
              0.125F * density[i + static_cast<std::size_t>(2 * m) * (j + 2 * m * k)];
    density = std::move(coarse);
    levels.emplace_back(m, density, length / m);
  }
  density = {};
  Multigrid precondition(levels, unit, 2);
  const Level& fine = levels.front();
  const std::size_t size = fine.size();
  const double shift = strain * length;
  // Unknowns: everything on cells but what is held. Started from the uniform strain along z, with held parts in place.
  std::vector<double> u(size, 0.0), p(size), Ap(size), r(size);
  for (int k = 0; k <= n; ++k)
    for (std::size_t i = fine.node(0, 0, k); i < fine.node(0, 0, k) + static_cast<std::size_t>(n + 1) * (n + 1); ++i)
      if (fine.inverse_diagonal[i] > 0.0F) u[2 * fine.nodes() + i] = shift * k / n;
  std::vector<float> residual(size, 0.0F), z(size, 0.0F);
  apply(fine, unit, u.data(), Ap.data());
  for (std::size_t i = 0; i < size; ++i) r[i] = -Ap[i];
  std::fill(p.begin(), p.end(), 0.0);
  double rz = 0.0, first = 0.0;
  int iterations = 0;
  for (; iterations < 500; ++iterations) {
    // In single precision numbers as small as these residuals keep all their digits only if scaled.
    const double scale = 1.0 / std::sqrt(dot(r, r));
    for (std::size_t i = 0; i < size; ++i) residual[i] = static_cast<float>(scale * r[i]);
    precondition(residual.data(), z.data());
    const double next = dot(r, z) / scale;
    if (iterations == 0) first = next;
    if (next <= tolerance * tolerance * first) break;
    const double beta = iterations == 0 ? 0.0 : next / rz;
    rz = next;
    for (std::size_t i = 0; i < size; ++i) p[i] = z[i] / scale + beta * p[i];
    apply(fine, unit, p.data(), Ap.data());
    const double alpha = rz / dot(p, Ap);
    for (std::size_t i = 0; i < size; ++i) {
      u[i] += alpha * p[i];
      r[i] -= alpha * Ap[i];
    }
  }
  // Cell by cell, as held parts have no row.
  double energy = 0.0;
  for (int k = 0; k < n; ++k)
    for (int j = 0; j < n; ++j)
      for (int i = 0; i < n; ++i) {
        const double modulus = fine.modulus[fine.cell(i, j, k)];
        if (modulus == 0.0) continue;
        Eigen::Matrix<double, local, 1> v;
        for (int c = 0; c < 3; ++c)
          for (int a = 0; a < corners; ++a)
            v[corners * c + a] = u[c * fine.nodes() + fine.node(i + (a & 1), j + (a >> 1 & 1), k + (a >> 2))];
        energy += 0.5 * modulus * v.dot(unit * v);
      }
  long unknowns = 0;
  for (const float d : fine.inverse_diagonal) unknowns += d > 0.0F ? 3 : 0;
  fine.for_held([&](std::size_t dof) { unknowns -= fine.inverse_diagonal[dof % fine.nodes()] > 0.0F ? 1 : 0; });
  peers::print_line(name, cells, unknowns, 2.0 * energy / (strain * strain * length * length * length), reference,
                    iterations, 0.0, peers::cpu_seconds() - start);
}

}  // namespace

int main(int argc, char** argv) {
  const std::string body = argc > 1 ? argv[1] : "block";
  const double cell = argc > 2 ? std::atof(argv[2]) : 1.0, tolerance = argc > 3 ? std::atof(argv[3]) : 1e-3;
  peers::print_head();
  if (body == "block") {
    const auto image = peers::porous_block();
    const int voxels = image.size[0], step = static_cast<int>(cell), n = voxels / step;
    std::vector<float> density(static_cast<std::size_t>(n) * n * n, 0.0F);
    for (int k = 0; k < voxels; ++k)
      for (int j = 0; j < voxels; ++j)
        for (int i = 0; i < voxels; ++i)
          density[i / step + static_cast<std::size_t>(n) * (j / step + n * (k / step))] +=
              static_cast<float>(image.at({i, j, k})) / static_cast<float>(step * step * step);
    run("voxels, block, " + std::to_string(step) + " to a side of a cell", n, std::move(density), voxels,
        peers::block_modulus, tolerance);
  } else {
    const int n = static_cast<int>(std::lround(96.0 / cell));
    constexpr int samples = 4;
    std::vector<float> density;
    for (int k = 0; k < n; ++k)
      for (int j = 0; j < n; ++j)
        for (int i = 0; i < n; ++i) {
          int inside = 0;
          for (int s = 0; s < samples * samples * samples; ++s) {
            const auto at = [&](int base, int sub) { return cell * (base + (sub + 0.5) / samples); };
            inside +=
                peers::gyroid(at(i, s % samples), at(j, s / samples % samples), at(k, s / samples / samples)) < 0.0;
          }
          density.push_back(static_cast<float>(inside) / (samples * samples * samples));
        }
    char name[64];
    std::snprintf(name, sizeof name, "voxels, gyroid, cells of %g", cell);
    run(name, n, std::move(density), 96.0, peers::gyroid_modulus, tolerance);
  }
}
