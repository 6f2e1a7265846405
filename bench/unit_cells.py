#!/usr/bin/env python3
# SPDX-License-Identifier: GPL-3.0-or-later
"""Effective tensors of meshed unit cells: true error against the reported one, and whether opposite sides have other
meshes. bench/unit_cells.py [EFREE]; EFREE: the program, by default build/efree. Prints a table."""

import json
import math
import pathlib
import subprocess
import sys
import tempfile

PROGRAM = str(pathlib.Path(sys.argv[1] if len(sys.argv) > 1 else "build/efree").resolve())


def cell(inclusions, dim, is_void):
    """A unit square or cube with disks or balls (centre, radius) in it, cut off at the frame."""
    lines = ['SetFactory("OpenCASCADE");']
    solid = "Surface" if dim == 2 else "Volume"
    lines.append("Rectangle(1) = {0, 0, 0, 1, 1};" if dim == 2 else "Box(1) = {0, 0, 0, 1, 1, 1};")
    for i, (centre, radius) in enumerate(inclusions):
        shape = "Disk" if dim == 2 else "Sphere"
        lines.append(f"{shape}({i + 2}) = {{{', '.join(map(str, list(centre) + [0] * (3 - dim)))}, {radius}}};")
    last = len(inclusions) + 1
    lines.append(f"inner() = BooleanIntersection{{ {solid}{{1}}; }}{{ {solid}{{2:{last}}}; Delete; }};")
    lines.append(f"outer() = BooleanDifference{{ {solid}{{1}}; Delete; }}{{ {solid}{{inner()}}; {'Delete;' if is_void else ''} }};")
    if not is_void:
        lines.append(f"BooleanFragments{{ {solid}{{outer(), inner()}}; Delete; }}{{ }}")
        lines.append(f'Physical {solid}("inner") = {{inner()}};')
    lines.append(f'Physical {solid}("outer") = {{outer()}};')
    return "\n".join(lines)


def board():
    """Four squares."""
    lines = ['SetFactory("OpenCASCADE");']
    for i in range(4):
        lines.append(f"Rectangle({i + 1}) = {{{0.5 * (i % 2)}, {0.5 * (i // 2)}, 0, 0.5, 0.5}};")
    lines.append("BooleanFragments{ Surface{1:4}; Delete; }{ }")
    lines.append('Physical Surface("outer") = {1, 4};\nPhysical Surface("inner") = {2, 3};')
    return "\n".join(lines)


def solve(geo, dim, kind, size, outer, inner, boundary="periodic"):
    regions = [("outer", outer)] + ([("inner", inner)] if inner else [])
    text = f'[analysis]\nkind = "effective"\n' + ('plane = "strain"\n' if dim == 2 else "")
    text += f'[effective]\nproperty = "{kind}"\nboundary = "{boundary}"\n[geometry]\nfile = "cell.geo"\nmesh_size = {size}\n'
    for name, values in regions:
        text += f'[[material]]\nregion = "{name}"\n' + "".join(f"{key} = {value}\n" for key, value in values.items())
    with tempfile.TemporaryDirectory() as folder:
        (pathlib.Path(folder) / "cell.geo").write_text(geo + "\n")
        (pathlib.Path(folder) / "case.toml").write_text(text)
        run = subprocess.run([PROGRAM, "solve", "case.toml", "--out", "out", "--no-picture"], cwd=folder,
                             capture_output=True, text=True)
        if run.returncode:
            sys.exit(run.stdout + run.stderr)
        result = json.loads((pathlib.Path(folder) / "out/result.json").read_text())
        return result, (run.stdout + run.stderr).count("have other meshes")


def kelvin_distance(a, b):
    """Of two tensors, relative to b."""
    n = len(a)
    normal = {6: 3, 3: 2}.get(n, n)
    weight = lambda i, j: (2 if i >= normal else 1) * (2 if j >= normal else 1)
    if n == 2 or normal == n:
        weight = lambda i, j: 1
    norm = lambda f: math.sqrt(sum(weight(i, j) * f(i, j) ** 2 for i in range(n) for j in range(n)))
    return norm(lambda i, j: a[i][j] - b[i][j]) / norm(lambda i, j: b[i][j])


def square_array(f, k):
    """Conductivity of a square array of disks (Perrins, McKenzie & McPhedran 1979), matrix 1."""
    T = (1 + k) / (1 - k)
    return 1 - 2 * f / (T + f - 0.305827 * f**4 * T / (T * T - 1.402958 * f**8) - 0.013362 * f**8 / T)


def diagonal(k, dim):
    return [[k if i == j else 0.0 for j in range(dim)] for i in range(dim)]


def cubic(c11, c12, c44):
    return [[c11 if i == j and i < 3 else c44 if i == j else c12 if i < 3 and j < 3 else 0.0 for j in range(6)]
            for i in range(6)]


def corners(dim):
    return [tuple(int(bool(n & (1 << d))) for d in range(dim)) for n in range(2**dim)]


def main():
    middle2, middle3 = [((0.5, 0.5), 0.35)], [((0.5, 0.5, 0.5), (0.75 * 0.2 / math.pi) ** (1 / 3))]
    corners2 = [(c, 0.35) for c in corners(2)]
    corners3 = [(c, middle3[0][1]) for c in corners(3)]
    sides2 = [((0, 0.5), 0.35), ((1, 0.5), 0.35)]
    f = math.pi * 0.35**2
    k = lambda value: {"conductivity": value}
    m = lambda E, nu: {"E": E, "nu": nu}
    pores = cubic(8.6951, 3.1757, 2.4610)
    cases = [
        ("disks in the middle, k = 10", middle2, 2, "conductivity", k(1), k(10), [0.1, 0.05], diagonal(square_array(f, 10), 2)),
        ("disks in the corners, k = 10", corners2, 2, "conductivity", k(1), k(10), [0.1, 0.05], diagonal(square_array(f, 10), 2)),
        ("disks in the corners, k = 1000", corners2, 2, "conductivity", k(1), k(1000), [0.1, 0.05], diagonal(square_array(f, 1000), 2)),
        ("halves of holes on two sides, k", sides2, 2, "conductivity", k(1), None, [0.1, 0.05], diagonal(square_array(f, 0), 2)),
        ("checkerboard, k = 10", None, 2, "conductivity", k(1), k(10), [0.05, 0.02], diagonal(math.sqrt(10), 2)),
        ("disks in the corners, E = 1000", corners2, 2, "stiffness", m(1, 0.3), m(1000, 0.2), [0.1, 0.05], None),
        ("disks in the corners, E = 10, matrix nu = 0.499", corners2, 2, "stiffness", m(1, 0.499), m(10, 0.2), [0.1, 0.05], None),
        ("halves of holes on two sides, E", sides2, 2, "stiffness", m(1, 0.3), None, [0.1, 0.05], None),
        ("spherical pores in the middle, k", middle3, 3, "conductivity", k(1), None, [0.2, 0.1], diagonal(0.72668, 3)),
        ("spherical pores in the corners, k", corners3, 3, "conductivity", k(1), None, [0.2, 0.1], diagonal(0.72668, 3)),
        ("spherical pores in the corners, E", corners3, 3, "stiffness", m(10, 0.3), None, [0.2, 0.1], pores),
    ]
    print("| cell | mesh_size | cells | pairs of sides with other meshes | error, true | reported | ratio |")
    print("|---|--:|--:|--:|--:|--:|--:|")
    for name, inclusions, dim, kind, outer, inner, sizes, exact in cases:
        geo = cell(inclusions, dim, inner is None) if inclusions else board()
        if exact is None:
            exact = solve(geo, dim, kind, sizes[-1] / 5, outer, inner)[0]["tensor"]
        for size in sizes:
            result, other = solve(geo, dim, kind, size, outer, inner)
            true, reported = kelvin_distance(result["tensor"], exact), result["error"]["grid"]
            print(f"| {name} | {size} | {result['grids'][0]['cells']} | {other} of {dim} | {100 * true:.2g} % | "
                  f"{100 * reported:.2g} % | {reported / true:.1f} |", flush=True)


main()
