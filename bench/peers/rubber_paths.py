#!/usr/bin/env python3
# SPDX-License-Identifier: GPL-3.0-or-later
"""Load paths of examples/rubber/plate.toml by efree, NGSolve and FElupe, and their errors against seconds.

usage: rubber_paths.py [--repetitions 3] [--out DIR] [--efree PROGRAM]

Needs ngsolve and felupe (README.md) in the Python it runs with. Every program goes the same ten steps on one thread; the
error is the largest difference to the reference, at these ten, over its largest force. Seconds are the processor's, from
the geometry on: mesh, functions, steps; not start-up, imports and output. One repetition goes through all of them, so that
whatever else the machine does falls on all alike; medians are printed and written to DIR/rubber_paths.csv.
"""
import argparse
import csv
import json
import os
import pathlib
import statistics
import subprocess
import sys
import time

HERE = pathlib.Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parent))
from load_paths import path_of, varied  # noqa: E402

CASE = HERE.parent.parent / "examples/rubber/plate.toml"
ENVIRONMENT = dict(os.environ, OMP_NUM_THREADS="1", OPENBLAS_NUM_THREADS="1")
REFERENCE = "NGSolve order 6", "0.05 6"
STEPS = 10

SERIES = {
    "efree cloud": ["0.5", "0.35", "0.25", "0.18", "0.125", "0.0625"],
    "efree corrected": ["0.5", "0.35", "0.25", "0.125"],
    "efree P1": ["0.2", "0.1", "0.05", "0.025", "0.0125"],
    "efree P2": ["0.4", "0.2", "0.1", "0.05", "0.025"],
    "NGSolve P2": ["0.8 2", "0.4 2", "0.2 2", "0.1 2", "0.05 2"],
    "NGSolve order 4": ["0.8 4", "0.4 4", "0.2 4"],
    "FElupe Q1": ["4 1", "8 1", "16 1", "32 1", "64 1"],
    "FElupe Q2": ["2 2", "4 2", "8 2", "16 2"],
}


def efree_once(program, text, folder, more=()):
    """What a run says of itself; its seconds, of the processor: those of the clock by the share that it was given."""
    case = CASE.with_name(".rubber_paths.toml")  # beside: it names files there
    case.write_text(text)
    start = time.monotonic()
    try:
        with open(f"{folder}.log", "w") as said:
            child = subprocess.Popen([program, "solve", case, "--out", folder, "--quiet", "--no-picture", *more],
                                     env=ENVIRONMENT, stdout=said, stderr=said)
            _, status, usage = os.wait4(child.pid, 0)
    finally:
        case.unlink()
    if status != 0:
        raise RuntimeError(f"efree ended with {status}: {said.name}")
    share = min(1.0, (usage.ru_utime + usage.ru_stime) / (time.monotonic() - start))
    result = json.loads((folder / "result.json").read_text())
    return result, {stage: share * seconds for stage, seconds in result["seconds"].items()}


def efree(program, out, kind, size):
    """Path, unknowns and seconds. The corrected path takes the end of every step for the end of the case."""
    folder = out / f"efree-{kind}-{size}"
    if kind != "corrected":
        result, seconds = efree_once(program, varied(CASE.read_text(), kind, size), folder)
        spent = seconds["total"] - seconds["output"] - seconds.get("correction", 0.0)
        path = path_of(folder / "history.csv", "reaction.right.x")[1:]
        return path, 2 * result["counts"]["nodes"], spent
    text = varied(CASE.read_text(), "cloud", size).replace('plane = "strain"', 'plane = "strain"\nessential = "strong"')
    path, spent = [], 0.0
    for step in range(1, STEPS + 1):
        until = text.replace("end = 1\n", f"end = {step / STEPS:g}\n")
        result, seconds = efree_once(program, until, folder, ["--resume"] if step > 1 else [])
        spent += seconds["path"] + seconds["correction"]
        if step == 1:  # once for all: what comes before the steps
            spent += seconds["total"] - seconds["output"] - seconds["path"] - seconds["correction"]
        path.append((step / STEPS, result["reactions"]["right"]["force"][0]))
    return path, 2 * result["counts"]["nodes"], spent


def peer(name, setting):
    run = subprocess.run([sys.executable, HERE / f"rubber_plate_{name.split()[0].lower()}.py", *setting.split()],
                         env=ENVIRONMENT, stdout=subprocess.PIPE, text=True, check=True)
    lines = run.stdout.splitlines()
    said = {line.split()[1]: float(line.split()[2]) for line in lines if line.startswith("#")}
    rows = csv.DictReader(line for line in lines if not line.startswith("#"))
    return [(float(row["t"]), float(row["force"])) for row in rows], int(said["unknowns"]), said["seconds"]


def main():
    parser = argparse.ArgumentParser(usage=__doc__)
    parser.add_argument("--repetitions", type=int, default=3)
    parser.add_argument("--out", type=pathlib.Path, default=pathlib.Path("out/rubber_paths"))
    parser.add_argument("--efree", default="build/efree")
    arguments = parser.parse_args()
    arguments.out.mkdir(parents=True, exist_ok=True)
    reference, _, _ = peer(*REFERENCE)
    largest = max(abs(force) for _, force in reference)
    found = {}
    for _ in range(arguments.repetitions):
        for name, settings in SERIES.items():
            for setting in settings:
                program, kind = name.split(maxsplit=1)
                path, unknowns, seconds = (efree(arguments.efree, arguments.out, kind.lower(), setting)
                                           if program == "efree" else peer(name, setting))
                if any(abs(t - there) > 1e-9 for (t, _), (there, _) in zip(path, reference, strict=True)):
                    raise RuntimeError(f"{name} {setting} went other steps")
                off = max(abs(force - there) for (_, force), (_, there) in zip(path, reference)) / largest
                found.setdefault((name, setting), (unknowns, off, path[-1][1], []))[3].append(seconds)
    print(f"reference: {REFERENCE[0]}, force at the end {reference[-1][1]:.7g}\n\n"
          "| functions | setting | unknowns | force at the end | path off by | seconds |\n|---|---|---|---|---|---|")
    with open(arguments.out / "rubber_paths.csv", "w") as table:
        print("functions,setting,unknowns,seconds,error", file=table)
        for (name, setting), (unknowns, off, end, seconds) in found.items():
            spent = statistics.median(seconds)
            print(f"{name},{setting},{unknowns},{spent:.4g},{off:.4g}", file=table)
            print(f"| {name} | {setting} | {unknowns} | {end:.6f} | {100 * off:.2g} % | {spent:.2g} |")


if __name__ == "__main__":
    main()
