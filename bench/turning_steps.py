#!/usr/bin/env python3
# SPDX-License-Identifier: GPL-3.0-or-later
"""Errors of load paths by the size of their steps: a block whose top is moved along a circle.

Usage: turning_steps.py PROGRAM. Prints for three materials, four sizes of steps and steps that are left open the
largest difference of the force to the same cloud with 1000 steps, what the run states of it, their ratio and the time
of the run. Takes half a minute.
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
mesh_size = 0.04
[cloud]
spacing = 0.16
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
displacement = ["{size}*sin({turns}*t)", "{size}*(1-cos({turns}*t))"]
"""
MATERIALS = {
    "small strains": ('yield = "0.2 + 20*a"', 0.01, 5),
    "finite strains": ('strain = "finite"\nyield = "0.2 + 20*a"', 0.1, 5),
    "kinematic hardening": ("yield = 0.2\nkinematic = 30", 0.01, 9),
}


def solve(program, folder, material, step):
    text, size, turns = MATERIALS[material]
    steps = f"step = {step}\nmax_step = {step}" if step else ""
    case = folder / "case.toml"
    case.write_text(CASE.format(material=text, steps=steps, size=size, turns=turns))
    out = folder / "out"
    start = time.perf_counter()
    subprocess.run([program, "solve", case, "--out", out, "--threads", "1"], capture_output=True, check=False)
    seconds = time.perf_counter() - start
    with open(out / "history.csv", encoding="utf-8") as history:
        forces = {
            round(float(row["t"]), 9): (float(row["reaction.top.x"]), float(row["reaction.top.y"]))
            for row in csv.DictReader(history)
        }
    return forces, json.loads((out / "result.json").read_text())["estimates"]["path"]["steps"], seconds


def at(when, forces):
    """The force at a time, on straight between steps."""
    after = min(t for t in forces if t >= when - 1e-9)
    before = max((t for t in forces if t < after), default=0.0)
    share = (when - before) / (after - before)
    return [(1 - share) * b + share * a for b, a in zip(forces.get(before, (0.0, 0.0)), forces[after])]


def main():
    program = pathlib.Path(sys.argv[1]).resolve()
    print("| material | step | steps | true [%] | stated [%] | ratio | time [s] |\n|---|---|---|---|---|---|---|")
    for material in MATERIALS:
        with tempfile.TemporaryDirectory() as folder:
            truth, *_ = solve(program, pathlib.Path(folder), material, 0.001)
        for step in (0.25, 0.125, 0.05, 0.02, None):
            with tempfile.TemporaryDirectory() as folder:
                forces, stated, seconds = solve(program, pathlib.Path(folder), material, step)
            off = max(math.dist(forces[t], at(t, truth)) for t in forces)
            off /= max(math.hypot(*force) for force in truth.values())
            print(
                f"| {material} | {step or 'left open'} | {len(forces)} | {100 * off:.2g} | {100 * stated:.2g} "
                f"| {stated / off:.2f} | {seconds:.2g} |"
            )


if __name__ == "__main__":
    main()
