#!/usr/bin/env python3
# SPDX-License-Identifier: GPL-3.0-or-later
"""Errors of load paths by the size of their steps: a block whose top is moved along a circle, and in cycles.

Usage: turning_steps.py PROGRAM. Prints for three materials, four sizes of steps and steps that are left open the
largest difference of the force to the same cloud with 1000 steps, what the run states of it, their ratio and the time
of the run; then for motions in cycles, with steps left open, what is dissipated against 4000 steps. Takes a minute.
"""
import csv
import json
import math
import pathlib
import subprocess
import sys
import tempfile
import time

CASE = """
title = "block moved along a circle"
[geometry]
shape = "rectangle"
parameters = {{ width = 1, height = 1 }}
mesh_size = {mesh_size}
[cloud]
spacing = {spacing}
[analysis]
plane = "strain"
[material]
model = "j2"
E = 200
nu = 0.3
{material}
[time]
end = 1
{steps}
[[boundary]]
on = "bottom"
displacement = [0, 0]
[[boundary]]
on = "top"
displacement = ["{x}", "{y}"]
"""
CYCLES = {
    "100 small cycles on a large mean": ("0", "0.1*min(10*t,1) + 0.004*sin(200*pi*t)"),
    "the same across it": ("0.1*min(10*t,1)", "0.004*sin(200*pi*t)"),
    "320 cycles": ("0", "0.004*sin(640*pi*t)"),
    "a jump in 9 cycles": ("t > 0.33 ? 0.004 : 0", "0.005*sin(18*pi*t)"),
    "two loads in turn": ("0.01*max(0,sin(20*pi*t))", "0.01*max(0,-sin(20*pi*t))"),
    "a figure of eight, ten times": ("0.01*sin(20*pi*t)", "0.005*sin(40*pi*t)"),
    "cycles that grow": ("0", "0.01*t^2*sin(60*pi*t)"),
}
MATERIALS = {
    "small strains": ('yield = "0.2 + 20*a"', 0.01, 5),
    "finite strains": ('strain = "finite"\nyield = "0.2 + 20*a"', 0.1, 5),
    "kinematic hardening": ("yield = 0.2\nkinematic = 30", 0.01, 9),
}


def solve(program, folder, material, x, y, step, mesh_size, spacing):
    steps = f"step = {step}\nmax_step = {step}" if step else ""
    case = folder / "case.toml"
    case.write_text(CASE.format(material=material, steps=steps, x=x, y=y, mesh_size=mesh_size, spacing=spacing))
    out = folder / "out"
    start = time.perf_counter()
    subprocess.run([program, "solve", case, "--out", out, "--threads", "1"], capture_output=True, check=False)
    seconds = time.perf_counter() - start
    with open(out / "history.csv", encoding="utf-8") as history:
        rows = list(csv.DictReader(history))
    return rows, json.loads((out / "result.json").read_text()), seconds


def solve_circle(program, folder, material, step):
    text, size, turns = MATERIALS[material]
    x, y = f"{size}*sin({turns}*t)", f"{size}*(1-cos({turns}*t))"
    rows, result, seconds = solve(program, folder, text, x, y, step, 0.04, 0.16)
    forces = {round(float(row["t"]), 9): (float(row["reaction.top.x"]), float(row["reaction.top.y"])) for row in rows}
    return forces, result["estimates"]["path"]["steps"], seconds


def at(when, forces):
    """The force at a time, on straight between steps."""
    after = min(t for t in forces if t >= when - 1e-9)
    before = max((t for t in forces if t < after), default=0.0)
    share = (when - before) / (after - before)
    return [(1 - share) * b + share * a for b, a in zip(forces.get(before, (0.0, 0.0)), forces[after])]


def print_circles(program):
    print("| material | step | steps | true [%] | stated [%] | ratio | time [s] |\n|---|---|---|---|---|---|---|")
    for material in MATERIALS:
        with tempfile.TemporaryDirectory() as folder:
            truth, *_ = solve_circle(program, pathlib.Path(folder), material, 0.001)
        for step in (0.25, 0.125, 0.05, 0.02, None):
            with tempfile.TemporaryDirectory() as folder:
                forces, stated, seconds = solve_circle(program, pathlib.Path(folder), material, step)
            off = max(math.dist(forces[t], at(t, truth)) for t in forces)
            off /= max(math.hypot(*force) for force in truth.values())
            print(
                f"| {material} | {step or 'left open'} | {len(forces)} | {100 * off:.2g} | {100 * stated:.2g} "
                f"| {stated / off:.2f} | {seconds:.2g} |"
            )


def print_cycles(program):
    print("| motion | steps | dissipated off [%] | stated [%] | warned | time [s] |\n|---|---|---|---|---|---|")
    material = "yield = 0.2\nkinematic = 20"
    for motion, (x, y) in CYCLES.items():
        with tempfile.TemporaryDirectory() as folder:
            truth, *_ = solve(program, pathlib.Path(folder), material, x, y, 0.00025, 0.1, 0.4)
        with tempfile.TemporaryDirectory() as folder:
            rows, result, seconds = solve(program, pathlib.Path(folder), material, x, y, None, 0.1, 0.4)
        off = float(rows[-1]["dissipated"]) / float(truth[-1]["dissipated"]) - 1.0
        path = result["estimates"]["path"]
        # Both are of the same cloud: its own error is not in the difference.
        warned = any("turn" in warning for warning in result["reports"].get("warnings", []))
        print(
            f"| {motion} | {len(rows)} | {100 * off:.2g} | {100 * path['steps']:.2g} (by steps), "
            f"{100 * path['dissipated']:.2g} | {'yes' if warned else 'no'} | {seconds:.2g} |"
        )


def main():
    program = pathlib.Path(sys.argv[1]).resolve()
    print_circles(program)
    print()
    print_cycles(program)


if __name__ == "__main__":
    main()
