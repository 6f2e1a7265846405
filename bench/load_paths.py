#!/usr/bin/env python3
# SPDX-License-Identifier: GPL-3.0-or-later
"""Load paths of a case by clouds and by finite elements, and their errors against time.

usage: load_paths.py CASE.toml PART COMPONENT VARIANT... [--out DIR] [--efree PROGRAM]

VARIANT: cloud:SPACING, p1:SIZE or p2:SIZE (length of edges); the last is the reference. Runs the case with each on one
thread, and prints a table: the force of PART at the end, the largest difference of its path from that of the reference
over the largest force, what the run itself says of it by a coarser cloud, and seconds of the processor (mesh,
functions, steps; "estimate" apart). DIR gets paths.csv
(variant, time, force) and errors.csv.
"""
import argparse
import csv
import json
import os
import pathlib
import re
import subprocess
import sys


def varied(text, kind, size):
    """The case with this cloud, or these elements."""
    if kind == "cloud":
        return re.sub(r"(?m)^spacing *=.*$", f"spacing = {size}", text)
    text = re.sub(r"(?m)^mesh_(ratio|size) *=.*$", f"mesh_size = {size}", text)
    text = re.sub(r"(?ms)^\[cloud\].*?(?=^\[)", "", text)
    return text.replace("[material]", f'[basis]\nkind = "{kind}"\n\n[material]', 1)


def path_of(file, column):
    with open(file, newline="") as stream:
        rows = list(csv.DictReader(stream))
    return [(0.0, 0.0)] + [(float(row["t"]), float(row[column])) for row in rows]


def at(path, time):
    """Linear between steps."""
    for (t0, f0), (t1, f1) in zip(path, path[1:]):
        if t0 <= time <= t1:
            return f0 + (f1 - f0) * (time - t0) / (t1 - t0)
    return None


def main():
    parser = argparse.ArgumentParser(usage=__doc__)
    parser.add_argument("case", type=pathlib.Path)
    parser.add_argument("part")
    parser.add_argument("component")
    parser.add_argument("variants", nargs="+")
    parser.add_argument("--out", type=pathlib.Path, default=pathlib.Path("out/load_paths"))
    parser.add_argument("--efree", default="build/efree")
    arguments = parser.parse_args()
    text = arguments.case.read_text()
    arguments.out.mkdir(parents=True, exist_ok=True)
    environment = dict(os.environ, OMP_NUM_THREADS="1")
    runs = []
    for variant in arguments.variants:
        kind, size = variant.split(":")
        case = arguments.case.with_name(f".{arguments.case.stem}.{kind}-{size}.toml")  # beside: it names files there
        folder = arguments.out / f"{kind}-{size}"
        case.write_text(varied(text, kind, size))
        try:
            run = subprocess.run([arguments.efree, "solve", case, "--out", folder, "--quiet", "--no-picture"],
                                 env=environment, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
        finally:
            case.unlink()
        if not (folder / "history.csv").exists():
            print(f"{variant}: {run.stdout.strip()}", file=sys.stderr)
            continue
        result = json.loads((folder / "result.json").read_text())
        runs.append((variant, path_of(folder / "history.csv", f"reaction.{arguments.part}.{arguments.component}"), result))
    reference = runs[-1][1]
    largest = max(abs(f) for _, f in reference)
    print("| functions | nodes | fine cells | force at the end | path off by | said | comes to | steps | steps and before [s] | estimate [s] |")
    print("|---|---|---|---|---|---|---|---|---|---|")
    with open(arguments.out / "paths.csv", "w") as paths, open(arguments.out / "errors.csv", "w") as errors:
        print("variant,t,force", file=paths)
        print("variant,seconds,error,nodes", file=errors)
        for variant, path, result in runs:
            for t, f in path:
                print(f"{variant},{t},{f}", file=paths)
            off = max((abs(f - there) for t, f in path if (there := at(reference, t)) is not None), default=0.0) / largest
            seconds = result["seconds"]
            estimate = seconds.get("correction", 0.0) + seconds.get("coarser cloud", 0.0)
            said = result.get("estimates", {}).get("path", {}).get("reactions", {}).get(arguments.part)
            print(f"{variant},{seconds['total'] - estimate - seconds.get('output', 0.0)},{off},{result['counts']['nodes']}", file=errors)
            print(f"| {variant} | {result['counts']['nodes']} | {result['counts']['fine_cells']} | {path[-1][1]:.6g} | {100 * off:.2g} % | "
                  f"{'' if said is None else f'{100 * said:.2g} %'} | "
                  f"{path[-1][0]:.4g} | {len(path) - 1} | {seconds['total'] - estimate - seconds.get('output', 0.0):.2f} | {estimate:.2f} |")


if __name__ == "__main__":
    main()
