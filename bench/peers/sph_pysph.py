#!/usr/bin/env python3
# SPDX-License-Identifier: GPL-3.0-or-later
"""Two colliding rubber rings by smoothed particles in PySPH and efree, run alternately on one thread.

  sph_pysph.py EFREE [--spacing M] [--until SECONDS] [--runs N]

Plane strain, cubic spline, smoothing length 1.2 spacings (20 neighbours), artificial stress 0.5, artificial viscosity 1
and 1. PySPH: Hooke's law in rates (Gray, Monaghan & Swift 2001) with its ElasticSolidsScheme, two evaluations of the
right-hand side a step, neighbours cached, compiled before the clock starts. efree: neo-Hookean, one evaluation a step.
Prints medians of CPU seconds, updates of particles per CPU second, and the kinetic energy and extent at the end.
"""
import argparse
import json
import os
import pathlib
import statistics
import subprocess
import sys
import tempfile

E, NU, DENSITY = 1e7, 0.3975, 1.0
INNER, OUTER, CENTRE = 0.03, 0.04, 0.041
SOUND = (E / (3 * (1 - 2 * NU) * DENSITY))**0.5
SPEED = 0.059 * SOUND
SMOOTHING = 1.2
COURANT = 0.3  # of PySPH


def run_pysph(d, until):
    """In a process of its own: prints particles, steps, CPU seconds, kinetic energy, largest x."""
    import time

    import numpy
    from pysph.base.kernels import CubicSpline
    from pysph.solver.application import Application
    from pysph.sph.solid_mech.basic import ElasticSolidsScheme, get_particle_array_elastic_dynamics

    class Rings(Application):
        def create_particles(self):
            n = int(OUTER / d) + 1
            x, y = [(a.ravel() + 0.5) * d for a in numpy.mgrid[-n:n, -n:n]]
            keep = (numpy.hypot(x, y) > INNER) & (numpy.hypot(x, y) < OUTER)
            x, y = numpy.concatenate([x[keep] - CENTRE, x[keep] + CENTRE]), numpy.concatenate([y[keep], y[keep]])
            one, h = numpy.ones_like(x), SMOOTHING * d
            rings = get_particle_array_elastic_dynamics(
                name="rings", x=x, y=y, m=DENSITY * d * d * one, rho=DENSITY * one, h=h * one, u=-SPEED * numpy.sign(x),
                constants={"wdeltap": CubicSpline(dim=2).kernel(rij=d, h=h), "n": 4, "rho_ref": DENSITY, "E": E,
                           "nu": NU})
            return [rings]

        def create_scheme(self):
            scheme = ElasticSolidsScheme(["rings"], [], dim=2, artificial_stress_eps=0.5, alpha=1.0, beta=1.0)
            scheme.configure_solver(dt=COURANT * SMOOTHING * d / SOUND, tf=until)
            return scheme

        def pre_step(self, solver):
            if solver.count == 0:
                self.start = time.process_time()

        def post_step(self, solver):
            self.steps, self.seconds = solver.count, time.process_time() - self.start

    with tempfile.TemporaryDirectory() as folder:
        rings = Rings(output_dir=folder)
        rings.run(["--disable-output", "--cache-nnps", "--no-openmp", "-d", folder])
    p = rings.particles[0]
    energy = 0.5 * float((p.m * (p.u**2 + p.v**2)).sum())
    print(len(p.x), rings.steps, rings.seconds, energy, float(p.x.max()) + 0.5 * d)


def run_efree(program, d, until):
    disks = "".join(f"Disk({i}) = {{{side * CENTRE}, 0, 0, {radius}}};\n" for i, side, radius in (
        (1, -1, OUTER), (2, -1, INNER), (3, 1, OUTER), (4, 1, INNER)))
    with tempfile.TemporaryDirectory() as name:
        folder = pathlib.Path(name)
        (folder / "rings.geo").write_text(f"""SetFactory("OpenCASCADE");
{disks}BooleanDifference{{ Surface{{1}}; Delete; }}{{ Surface{{2}}; Delete; }}
BooleanDifference{{ Surface{{3}}; Delete; }}{{ Surface{{4}}; Delete; }}
Physical Surface("left") = {{1}};
Physical Surface("right") = {{3}};
""")
        (folder / "rings.toml").write_text(f"""geometry = {{ file = "rings.geo", mesh_size = 4e-3 }}
analysis = {{ kind = "dynamics", plane = "strain" }}
material = {{ model = "neo_hookean", E = {E}, nu = {NU}, density = {DENSITY} }}
velocity = [{{ region = "left", value = [{SPEED}, 0] }}, {{ region = "right", value = [{-SPEED}, 0] }}]
probe = [{{ name = "right end", largest = "x" }}]
time.end = {until}
output.frames = 1
[sph]
spacing = {d}
smoothing = {SMOOTHING}
artificial_stress = {{ strength = 0.5 }}
viscosity = {{ linear = 1, quadratic = 1 }}
""")
        process = subprocess.Popen([program, "solve", "rings.toml", "--out", "out", "--threads", "1", "--no-picture",
                                    "--quiet"], cwd=folder)
        _, process.returncode, usage = os.wait4(process.pid, 0)
        if process.returncode:
            raise SystemExit("efree failed")
        result = json.loads((folder / "out/result.json").read_text())
    return (result["counts"]["nodes"], result["counts"]["steps"], usage.ru_utime + usage.ru_stime,
            result["energy"]["kinetic"], result["probes"]["right end"])


def main():
    arguments = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    arguments.add_argument("efree")
    arguments.add_argument("--spacing", type=float, default=6.63e-4)
    arguments.add_argument("--until", type=float, default=3e-5)
    arguments.add_argument("--runs", type=int, default=3)
    options = arguments.parse_args()
    d, until = options.spacing, options.until
    if options.efree == "pysph":
        return run_pysph(d, until)
    rows = {"PySPH": [], "efree": []}
    environment = os.environ | {"OMP_NUM_THREADS": "1"}
    for _ in range(options.runs):
        output = subprocess.run([sys.executable, __file__, "pysph", "--spacing", str(d), "--until", str(until)],
                                env=environment, stdout=subprocess.PIPE, text=True, check=True).stdout
        rows["PySPH"].append([float(word) for word in output.splitlines()[-1].split()])
        rows["efree"].append(run_efree(str(pathlib.Path(options.efree).resolve()), d, until))
    print("| program | particles | steps | CPU s (range) | million updates per CPU s | kinetic J | right end mm |")
    for name, runs in rows.items():
        count, steps, _, energy, end = runs[0]
        times = sorted(run[2] for run in runs)
        seconds = statistics.median(times)
        print(f"| {name} | {count:.0f} | {steps:.0f} | {seconds:.3g} ({times[0]:.3g} to {times[-1]:.3g}) | "
              f"{1e-6 * count * steps / seconds:.3g} | {energy:.4g} | {1e3 * end:.4g} |", flush=True)


if __name__ == "__main__":
    main()
