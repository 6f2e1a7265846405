#!/usr/bin/env python3
# SPDX-License-Identifier: GPL-3.0-or-later
"""examples/rubber/plate.toml by NGSolve: triangles of any order, curved along the hole, Newton's method on the energy.

usage: rubber_plate_ngsolve.py SIZE ORDER

Prints "t,force" for each step, and as comments the number of unknowns and seconds of the processor from the geometry on
(imports, half a second or so, left out).
"""
import sys

from netgen.geom2d import SplineGeometry
from ngsolve import (BilinearForm, Det, GridFunction, Grad, Id, InnerProduct, Mesh, SetNumThreads, SymbolicEnergy, TaskManager,
                     Trace, VectorH1, log)
from ngsolve.nonlinearsolvers import NewtonSolver

from timed_path import report

E, NU, EXTENSION, STEPS = 1.0, 0.3, 4.0, 10


def plate():
    """A quarter of a square plate of half width 2 with a hole of radius 1, as a rational spline."""
    geometry = SplineGeometry()
    points = [geometry.AppendPoint(*p) for p in [(1, 0), (2, 0), (2, 2), (0, 2), (0, 1), (1, 1)]]
    for k, name in enumerate(["bottom", "right", "top", "left"]):
        geometry.Append(["line", points[k], points[k + 1]], bc=name)
    geometry.Append(["spline3", points[4], points[5], points[0]], bc="hole")
    return geometry


def load_path(size, order):
    """[(t, force)], number of unknowns."""
    mesh = Mesh(plate().GenerateMesh(maxh=size))
    mesh.Curve(order)
    space = VectorH1(mesh, order=order, dirichletx="left|right", dirichlety="bottom")
    u = space.TrialFunction()
    mu, lam = E / (2 * (1 + NU)), E * NU / ((1 + NU) * (1 - 2 * NU))
    F = Id(2) + Grad(u)
    J = Det(F)
    a = BilinearForm(space, symmetric=True)
    a += SymbolicEnergy((mu / 2 * Trace(F.trans * F) - mu * log(J) + lam / 2 * log(J) ** 2).Compile())

    on_right = GridFunction(space)
    on_right.components[0].Set(1.0, definedon=mesh.Boundaries("right"))
    solution, prescribed = GridFunction(space), GridFunction(space)
    newton = NewtonSolver(a, solution, freedofs=space.FreeDofs(), inverse="sparsecholesky")
    forces = solution.vec.CreateVector()
    path = []
    for step in range(1, STEPS + 1):
        prescribed.vec.data = solution.vec + EXTENSION / STEPS * on_right.vec
        newton.SetDirichlet(prescribed.vec)
        status, _ = newton.Solve(maxerr=1e-8, maxit=20)
        if status != 0:
            raise RuntimeError(f"no balance in step {step}")
        a.Apply(solution.vec, forces)
        path.append((step / STEPS, InnerProduct(forces, on_right.vec)))
    return path, sum(space.FreeDofs())


def on_one_thread(size, order):
    SetNumThreads(1)
    with TaskManager():  # without, its Cholesky factors start threads each time: 20 ms, however small
        return load_path(size, order)


if __name__ == "__main__":
    report(lambda: on_one_thread(float(sys.argv[1]), int(sys.argv[2])))
