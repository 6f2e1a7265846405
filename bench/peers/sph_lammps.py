#!/usr/bin/env python3
# SPDX-License-Identifier: GPL-3.0-or-later
"""Taylor's bar by smoothed particles in LAMMPS (package MACHDYN) and efree, run alternately on one thread.

  sph_lammps.py LMP EFREE [--spacing MM] [--until US] [--runs N] [--methods NAMES]

Aluminium at 373 m/s on a rigid frictionless wall: linear elasticity, von Mises' surface with linear hardening. LAMMPS
has a constant wall penalty, the linear equation of state, its usual hourglass control of 10 and its usual tenth of the
stable step; supports have 2.4 spacings as efree's. Prints medians of CPU seconds, steps, and the shape at the end.
"""
import argparse
import json
import math
import os
import pathlib
import re
import statistics
import subprocess
import tempfile

# mm, ms, GPa, kg
RADIUS, LENGTH, SPEED = 3.91, 23.46, 373.0
E, NU, DENSITY, YIELD, HARDENING = 78.2, 0.3, 2700e-9, 0.29, 0.1
SUPPORT = 2.4  # over the spacing

LAMMPS_PAIRS = {
    "smd/tlsph": f"pair_style smd/tlsph\npair_coeff 1 1 *COMMON {DENSITY} {E} {NU} 0.06 0 10 1 "
                 f"*STRENGTH_LINEAR_PLASTIC {YIELD} {HARDENING} *EOS_LINEAR *END",
    "smd/ulsph": "pair_style smd/ulsph *DENSITY_CONTINUITY *VELOCITY_GRADIENT *GRADIENT_CORRECTION\n"
                 f"pair_coeff 1 1 *COMMON {DENSITY} {math.sqrt(E / (3 * (1 - 2 * NU) * DENSITY))} 1 1 10 "
                 f"*STRENGTH_LINEAR_PLASTIC {E / (2 * (1 + NU))} {YIELD} {HARDENING} *EOS_LINEAR *END"}


def write_lammps(folder, style, d, until):
    n = math.ceil(RADIUS / d)
    spots = [((i + 0.5) * d, (j + 0.5) * d, (k + 0.5) * d) for i in range(-n, n) for j in range(-n, n)
             for k in range(int(LENGTH / d)) if math.hypot((i + 0.5) * d, (j + 0.5) * d) < RADIUS]
    volume, box = math.pi * RADIUS**2 * LENGTH / len(spots), 3 * RADIUS
    rows = "".join(f"{i} 1 1 {volume} {volume * DENSITY} {SUPPORT * d / 2} {d / 2} {x} {y} {z} {x} {y} {z}\n"
                   for i, (x, y, z) in enumerate(spots, 1))
    (folder / "bar.data").write_text(f"bar\n\n{len(spots)} atoms\n1 atom types\n{-box} {box} xlo xhi\n{-box} {box} "
                                     f"ylo yhi\n-1 {LENGTH + 5} zlo zhi\n\nAtoms # smd\n\n{rows}")
    extremes = "".join(f"compute {name} all reduce {what}\n" for name, what in (
        ("top", "max z"), ("bottom", "min z"), ("left", "min x"), ("right", "max x"), ("flow", "max c_strain")))
    (folder / "in.bar").write_text(f"""units si
dimension 3
boundary s s s
atom_style smd
atom_modify map array
comm_modify vel yes
neigh_modify every 10 delay 0 check yes
newton off
neighbor {SUPPORT * d} bin
read_data bar.data
group tlsph type 1
velocity all set 0 0 {-SPEED} sum no units box
{LAMMPS_PAIRS[style]}
fix wall all wall/harmonic zlo 0 {0.5 * E * d} 0 {0.5 * d} units box
fix step all smd/adjust_dt 0.1
fix integrate all smd/integrate_{style[4:]}
compute strain all smd/plastic/strain
{extremes}variable time equal f_step
variable length equal c_top-c_bottom+{d}
variable foot equal c_right-c_left+{d}
thermo_style custom step f_step v_length v_foot c_flow
thermo 20
fix end all halt 1 v_time > {1e-3 * until} error continue message no
run 1000000
""")


def write_efree(folder, frame, d, until):
    probes = {"length": 'extent = "z"', "foot": 'extent = "x"', "flow": 'largest = "equivalent_plastic_strain"'}
    (folder / "bar.toml").write_text(f"""geometry = {{ shape = "cylinder", mesh_size = 1.2e-3, parameters = {{ \
radius = {1e-3 * RADIUS}, height = {1e-3 * LENGTH} }} }}
analysis.kind = "dynamics"
sph = {{ spacing = {1e-3 * d}, frame = "{frame}" }}
material = {{ model = "j2", strain = "finite", E = {1e9 * E}, nu = {NU}, density = {1e9 * DENSITY}, \
yield = "{1e9 * YIELD} + {1e9 * HARDENING}*a" }}
velocity = [{{ value = [0, 0, {-SPEED}] }}]
wall = [{{ normal = [0, 0, 1] }}]
time.end = {1e-6 * until}
output.frames = 1
""" + "".join(f'[[probe]]\nname = "{name}"\n{what}\n' for name, what in probes.items()))


def run(program, method, d, until):
    """CPU seconds, particles, steps, length, diameter of the foot [mm], largest plastic strain."""
    with tempfile.TemporaryDirectory() as name:
        folder = pathlib.Path(name)
        if method in LAMMPS_PAIRS:
            write_lammps(folder, method, d, until)
            command = [program, "-in", "in.bar", "-log", "log"]
        else:
            write_efree(folder, method, d, until)
            command = [program, "solve", "bar.toml", "--out", "out", "--threads", "1", "--no-picture", "--quiet"]
        process = subprocess.Popen(command, cwd=folder, stdout=subprocess.DEVNULL, stderr=subprocess.STDOUT,
                                   env=os.environ | {"OMP_NUM_THREADS": "1"})
        _, status, usage = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
        if process.returncode:
            raise SystemExit(f"{' '.join(command)}: exit status {process.returncode}")
        seconds = usage.ru_utime + usage.ru_stime
        if method in LAMMPS_PAIRS:
            log = (folder / "log").read_text()
            steps, count = map(int, re.search(r"Loop time of .* for (\d+) steps with (\d+) atoms", log).groups())
            last = re.findall(r"^ *\d+(?: +[-\d.e+]+){4} *$", log, re.M)[-1]  # the last line of numbers
            return seconds, count, steps, *map(float, last.split()[2:])
        result = json.loads((folder / "out/result.json").read_text())
        counts, probes = result["counts"], result["probes"]
        return (seconds, counts["nodes"], counts["steps"], 1e3 * probes["length"], 1e3 * probes["foot"], probes["flow"])


def main():
    arguments = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    arguments.add_argument("lmp")
    arguments.add_argument("efree")
    arguments.add_argument("--spacing", type=float, default=0.9, help="of particles, mm")
    arguments.add_argument("--until", type=float, default=40.0, help="microseconds")
    arguments.add_argument("--runs", type=int, default=3)
    arguments.add_argument("--methods", default="smd/tlsph,total,smd/ulsph,updated")
    options = arguments.parse_args()
    methods = options.methods.split(",")
    programs = {m: str(pathlib.Path(options.lmp if m in LAMMPS_PAIRS else options.efree).resolve()) for m in methods}
    rows = {method: [] for method in methods}
    for _ in range(options.runs):
        for method in methods:
            rows[method].append(run(programs[method], method, options.spacing, options.until))
    print("| method | particles | steps | CPU s (range) | million updates per CPU s | length mm | foot mm | plastic |")
    for method, runs in rows.items():
        times, (_, count, steps, *shape) = sorted(r[0] for r in runs), runs[0]
        seconds = statistics.median(times)
        print(f"| {method} | {count} | {steps} | {seconds:.3g} ({times[0]:.3g} to {times[-1]:.3g}) | "
              f"{1e-6 * count * steps / seconds:.3g} | {shape[0]:.4g} | {shape[1]:.4g} | {shape[2]:.3g} |", flush=True)


if __name__ == "__main__":
    main()
