#!/usr/bin/env python3
# SPDX-License-Identifier: GPL-3.0-or-later
"""Taylor's bar by the material point method in Taichi (from PyPI), beside `bench_mpm speed`: quadratic splines, APIC,
double precision, eight points a cell, Hencky's strains and von Mises' surface, one thread.

  mpm_taichi.py [BENCH_MPM] [--until SECONDS]

Prints updates of points per CPU second and the length of the bar; with the path of bench_mpm its rows after that.
"""
import argparse
import math
import subprocess
import time

import numpy as np
import taichi as ti

RADIUS, LENGTH, SPEED = 3.2e-3, 32.4e-3, 227.0
E, NU, DENSITY, YIELD, HARDENING = 117e9, 0.35, 8930.0, 400e6, 100e6
SPACING = 0.443e-3  # of points; cells are twice as wide
MU, LAM = E / (2 * (1 + NU)), E * NU / ((1 + NU) * (1 - 2 * NU))
COURANT = 0.5


def main():
    arguments = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    arguments.add_argument("bench_mpm", nargs="?")
    arguments.add_argument("--until", type=float, default=20e-6)
    options = arguments.parse_args()
    ti.init(arch=ti.cpu, cpu_max_num_threads=1, default_fp=ti.f64, offline_cache=False, log_level=ti.ERROR)

    h = 2 * SPACING
    n = math.ceil(LENGTH / h) + 6
    across = 2 * math.ceil(3 * RADIUS / h)
    spots = [((i + 0.5) * SPACING, (j + 0.5) * SPACING, (k + 0.5) * SPACING)
             for i in range(-20, 20) for j in range(-20, 20) for k in range(int(LENGTH / SPACING))
             if math.hypot((i + 0.5) * SPACING, (j + 0.5) * SPACING) < RADIUS]
    count, low = len(spots), (-across // 2 * h, -across // 2 * h, -3 * h)
    x = ti.Vector.field(3, ti.f64, count)
    v = ti.Vector.field(3, ti.f64, count)
    C = ti.Matrix.field(3, 3, ti.f64, count)
    F = ti.Matrix.field(3, 3, ti.f64, count)  # elastic
    strain = ti.field(ti.f64, count)
    grid_v = ti.Vector.field(3, ti.f64, (across, across, n))
    grid_m = ti.field(ti.f64, (across, across, n))
    volume = math.pi * RADIUS**2 * LENGTH / count
    mass = volume * DENSITY
    x.from_numpy(np.array(spots))
    v.from_numpy(np.tile([0.0, 0.0, -SPEED], (count, 1)))
    F.from_numpy(np.tile(np.eye(3), (count, 1, 1)))

    @ti.kernel
    def step(dt: ti.f64):
        for i in ti.grouped(grid_m):
            grid_m[i] = 0.0
            grid_v[i] = ti.Vector.zero(ti.f64, 3)
        for p in x:
            F[p] = (ti.Matrix.identity(ti.f64, 3) + dt * C[p]) @ F[p]
            U, S, V = ti.svd(F[p])
            e = ti.Vector([ti.log(S[0, 0]), ti.log(S[1, 1]), ti.log(S[2, 2])])
            trace = e.sum()
            deviator = e - trace / 3
            size = ti.sqrt(2.0 / 3.0) * deviator.norm()
            over = 3 * MU * size - (YIELD + HARDENING * strain[p])
            if over > 0:
                flow = over / (3 * MU + HARDENING)
                strain[p] += flow
                deviator *= 1 - flow / size
                e = deviator + trace / 3
                for d in ti.static(range(3)):
                    S[d, d] = ti.exp(e[d])
                F[p] = U @ S @ V.transpose()
            tau = ti.Matrix.zero(ti.f64, 3, 3)
            for d in ti.static(range(3)):
                tau[d, d] = 2 * MU * e[d] + LAM * trace
            affine = mass * C[p] - dt * volume * 4 / h**2 * (U @ tau @ U.transpose())
            base = ((x[p] - ti.Vector(low)) / h - 0.5).cast(int)
            s = (x[p] - ti.Vector(low)) / h - base
            w = [0.5 * (1.5 - s)**2, 0.75 - (s - 1)**2, 0.5 * (s - 0.5)**2]
            for i, j, k in ti.static(ti.ndrange(3, 3, 3)):
                at = ti.Vector([i, j, k])
                weight = w[i][0] * w[j][1] * w[k][2]
                grid_v[base + at] += weight * (mass * v[p] + affine @ ((at - s) * h))
                grid_m[base + at] += weight * mass
        for i in ti.grouped(grid_m):
            if grid_m[i] > 0:
                grid_v[i] /= grid_m[i]
                if i[2] <= 3 and grid_v[i][2] < 0:  # the wall
                    grid_v[i][2] = 0.0
        for p in x:
            base = ((x[p] - ti.Vector(low)) / h - 0.5).cast(int)
            s = (x[p] - ti.Vector(low)) / h - base
            w = [0.5 * (1.5 - s)**2, 0.75 - (s - 1)**2, 0.5 * (s - 0.5)**2]
            velocity, gradient = ti.Vector.zero(ti.f64, 3), ti.Matrix.zero(ti.f64, 3, 3)
            for i, j, k in ti.static(ti.ndrange(3, 3, 3)):
                at = ti.Vector([i, j, k])
                weight = w[i][0] * w[j][1] * w[k][2]
                velocity += weight * grid_v[base + at]
                gradient += 4 / h * weight * grid_v[base + at].outer_product(at - s)
            v[p], C[p] = velocity, gradient
            x[p] += dt * velocity

    dt = COURANT * h / (math.sqrt((LAM + 2 * MU) / DENSITY) + SPEED)
    steps = math.ceil(options.until / dt)
    step(0.0)  # compiles
    start = time.process_time()
    for _ in range(steps):
        step(dt)
    ti.sync()
    seconds = time.process_time() - start
    length = x.to_numpy()[:, 2].max() + 0.5 * SPACING
    print(f"taichi {'.'.join(map(str, ti.__version__))}: {count} points, {steps} steps of {dt:.3g} s, {seconds:.3g} CPU s, "
          f"{1e-6 * count * steps / seconds:.3g} million updates a second, length {1e3 * length:.4g} mm")
    if options.bench_mpm:
        subprocess.run([options.bench_mpm, "speed"], check=False)


if __name__ == "__main__":
    main()
