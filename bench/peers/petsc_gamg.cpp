// SPDX-License-Identifier: GPL-3.0-or-later
/// Linear tetrahedra on efree's mesh of the image, solved by PETSc: conjugate gradients with smoothed aggregation
/// (GAMG) that knows the rigid motions. One thread.
///
///   petsc_gamg block [size in voxels = 3] [tolerance = 1e-3] [PETSc options]
///   petsc_gamg gyroid [size in voxels = 3] [tolerance = 1e-3] [PETSc options]
///
/// Iterations end as those of voxel_multigrid do: when the preconditioned residual has fallen by the tolerance from
/// that of uniform strain.
#include "efree/geometry/meshing/image_mesh.hpp"
#include "problem.hpp"

#include <petscksp.h>
#include <algorithm>
#include <array>
#include <cstdlib>
#include <stdexcept>
#include <string>
#include <vector>

namespace {

constexpr double poisson = 0.3, strain = 0.01;

void check(PetscErrorCode error) {
  if (error) throw std::runtime_error("PETSc error " + std::to_string(error));
}

/// Rows of all unknowns, 3 * vertex + component, as PETSc keeps them.
struct Matrix {
  std::vector<PetscInt> begin{0}, columns;
  std::vector<PetscScalar> values;
};

/// Stiffness with E = 1 of everything, nothing held.
Matrix assemble(const efree::FineMesh<3>& mesh) {
  const double lambda = poisson / ((1 + poisson) * (1 - 2 * poisson)), mu = 0.5 / (1 + poisson);
  Matrix K;
  std::vector<PetscInt> around;
  for (efree::Index v = 0; v < mesh.num_vertices(); ++v) {
    around.clear();
    for (const efree::Index c : mesh.cells_of(v))
      for (const efree::Index w : mesh.cells().col(c)) around.push_back(w);
    std::sort(around.begin(), around.end());
    around.erase(std::unique(around.begin(), around.end()), around.end());
    const std::size_t first = K.values.size(), width = 3 * around.size();
    for (int i = 0; i < 3; ++i) {
      for (const PetscInt w : around)
        for (int j = 0; j < 3; ++j) K.columns.push_back(3 * w + j);
      K.begin.push_back(static_cast<PetscInt>(K.columns.size()));
    }
    K.values.resize(K.columns.size(), 0.0);
    for (const efree::Index c : mesh.cells_of(v)) {
      const auto dN = mesh.hat_gradients(c);
      efree::Index a = 0;
      while (mesh.cells()(a, c) != v) ++a;
      for (efree::Index b = 0; b < 4; ++b) {
        const auto at = std::lower_bound(around.begin(), around.end(), mesh.cells()(b, c)) - around.begin();
        const double both = mu * dN.col(a).dot(dN.col(b));
        for (int i = 0; i < 3; ++i)
          for (int j = 0; j < 3; ++j)
            K.values[first + i * width + 3 * at + j] +=
                mesh.volume(c) * (lambda * dN(i, a) * dN(j, b) + mu * dN(j, a) * dN(i, b) + (i == j ? both : 0.0));
      }
    }
  }
  return K;
}

void run(const std::string& name, const efree::LabelImage<3>& image, double size, double reference, double tolerance) {
  const double start = peers::cpu_seconds();
  const double length = image.size[2] * image.spacing[2];
  const efree::FineMesh<3> mesh(efree::mesh_image<3>(image, {.size = size}));
  const double meshed = peers::cpu_seconds();
  Matrix K = assemble(mesh);
  const auto n = static_cast<PetscInt>(K.begin.size() - 1);
  std::vector<char> held(n, 0);
  for (const auto& [part, component] : {std::pair{"left", 0}, {"front", 1}, {"bottom", 2}, {"top", 2}})
    for (const efree::Index f : mesh.group(part))
      for (const efree::Index v : mesh.facets().col(f)) held[3 * v + component] = 1;
  // Started from uniform strain, which moves the held planes to where they go; what is left is zero on them.
  Eigen::VectorXd u0 = Eigen::VectorXd::Zero(n), r(n);
  for (efree::Index v = 0; v < mesh.num_vertices(); ++v) u0[3 * v + 2] = strain * mesh.vertices()(2, v);
  double energy = 0.0;
  long unknowns = 0;
  for (PetscInt i = 0; i < n; ++i) {
    double row = 0.0;
    for (PetscInt k = K.begin[i]; k < K.begin[i + 1]; ++k) row += K.values[k] * u0[K.columns[k]];
    energy += 0.5 * u0[i] * row;
    r[i] = held[i] ? 0.0 : -row;
    unknowns += !held[i];
    for (PetscInt k = K.begin[i]; k < K.begin[i + 1]; ++k)
      if (K.columns[k] != i && (held[i] || held[K.columns[k]])) K.values[k] = 0.0;
  }

  Mat A = nullptr;
  Vec b = nullptr, x = nullptr, coordinates = nullptr;
  MatNullSpace rigid = nullptr;
  KSP solver = nullptr;
  PC preconditioner = nullptr;
  check(MatCreateSeqAIJWithArrays(PETSC_COMM_SELF, n, n, K.begin.data(), K.columns.data(), K.values.data(), &A));
  check(MatSetBlockSize(A, 3));
  check(MatSetOption(A, MAT_SPD, PETSC_TRUE));
  check(VecCreateSeqWithArray(PETSC_COMM_SELF, 3, n, mesh.vertices().data(), &coordinates));
  check(MatNullSpaceCreateRigidBody(coordinates, &rigid));
  check(MatSetNearNullSpace(A, rigid));
  check(VecCreateSeqWithArray(PETSC_COMM_SELF, 3, n, r.data(), &b));
  check(VecDuplicate(b, &x));
  check(KSPCreate(PETSC_COMM_SELF, &solver));
  check(KSPSetOperators(solver, A, A));
  check(KSPSetType(solver, KSPCG));
  check(KSPSetNormType(solver, KSP_NORM_NATURAL));
  check(KSPSetTolerances(solver, tolerance, 0.0, PETSC_DEFAULT, 1000));
  check(KSPGetPC(solver, &preconditioner));
  check(PCSetType(preconditioner, PCGAMG));
  check(KSPSetFromOptions(solver));
  check(KSPSolve(solver, b, x));
  PetscInt iterations = 0;
  KSPConvergedReason reason{};
  check(KSPGetIterationNumber(solver, &iterations));
  check(KSPGetConvergedReason(solver, &reason));
  if (reason < 0) throw std::runtime_error("conjugate gradients do not converge");
  // Energy of u0 + x, x up to the tolerance orthogonal to its own residual: E(u0) - r . x + x . K x / 2.
  Vec Kx = nullptr;
  PetscScalar work = 0.0, own = 0.0;
  check(VecDuplicate(b, &Kx));
  check(MatMult(A, x, Kx));
  check(VecDot(b, x, &work));
  check(VecDot(x, Kx, &own));
  energy += 0.5 * own - work;
  peers::print_line(name, mesh.num_cells(), unknowns, 2.0 * energy / (strain * strain * length * length * length),
                    reference, iterations, meshed - start, peers::cpu_seconds() - start);
}

}  // namespace

int main(int argc, char** argv) {
  const std::string body = argc > 1 ? argv[1] : "block";
  const double size = argc > 2 ? std::atof(argv[2]) : 3.0, tolerance = argc > 3 ? std::atof(argv[3]) : 1e-3;
  check(PetscInitialize(&argc, &argv, nullptr, nullptr));
  peers::print_head();
  char name[64];
  std::snprintf(name, sizeof name, "P1, GAMG, %s, size %g", body.c_str(), size);
  if (body == "block")
    run(name, peers::porous_block(), size, peers::block_modulus, tolerance);
  else
    run(name, peers::gyroid_voxels(96), size, peers::gyroid_modulus, tolerance);
  check(PetscFinalize());
}
