#!/usr/bin/env python3
# SPDX-License-Identifier: GPL-3.0-or-later
"""examples/rubber/plate.toml by FElupe: a mapped mesh of quadrilaterals with N cells from the hole to the edge, 2 N around
it, every node of the rim on the circle; Newton's method with SciPy's direct solver, as the program has it.

usage: rubber_plate_felupe.py N ORDER        (ORDER 1: bilinear, 2: biquadratic with nine nodes)

Prints "t,force" for each step, and as comments the number of unknowns and seconds of the processor from the geometry on
(imports, a second or so, left out).
"""
import sys

import felupe as fem
import numpy as np

from timed_path import report

E, NU, EXTENSION, STEPS = 1.0, 0.3, 4.0, 10


def plate(n, order):
    """From the rectangle of (share of the way from hole to edge, angle): straight rays between circle and square."""
    mesh = fem.Rectangle(b=(1.0, np.pi / 2), n=(n + 1, 2 * n + 1))
    if order == 2:
        mesh = fem.mesh.add_midpoints_faces(fem.mesh.add_midpoints_edges(mesh))
    s, angle = mesh.points.T
    ray = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    mesh.points = ray * (1 - s + s * 2 / ray.max(axis=1))[:, None]
    return mesh


def load_path(n, order):
    """[(t, force)], number of unknowns."""
    mesh = plate(n, order)
    region = (fem.RegionQuad if order == 1 else fem.RegionBiQuadraticQuad)(mesh)
    field = fem.FieldContainer([fem.FieldPlaneStrain(region, dim=2)])
    mu, lam = E / (2 * (1 + NU)), E * NU / ((1 + NU) * (1 - 2 * NU))
    solid = fem.SolidBody(fem.NeoHookeCompressible(mu=mu, lmbda=lam), field)
    boundaries = {
        "left": fem.Boundary(field[0], fx=lambda x: np.isclose(x, 0.0), skip=(False, True)),
        "bottom": fem.Boundary(field[0], fy=lambda y: np.isclose(y, 0.0), skip=(True, False)),
        "right": fem.Boundary(field[0], fx=lambda x: np.isclose(x, 2.0), skip=(False, True)),
    }
    path = []
    for step in range(1, STEPS + 1):
        boundaries["right"].value = EXTENSION * step / STEPS
        dof0, dof1 = fem.dof.partition(field, boundaries)
        ext0 = fem.dof.apply(field, boundaries, dof0)
        found = fem.newtonraphson(items=[solid], dof0=dof0, dof1=dof1, ext0=ext0, tol=1e-8, maxiter=20, verbose=0)
        path.append((step / STEPS, fem.tools.force(field, found.fun, boundaries["right"])[0]))
    return path, len(dof1)


if __name__ == "__main__":
    report(lambda: load_path(int(sys.argv[1]), int(sys.argv[2])))
