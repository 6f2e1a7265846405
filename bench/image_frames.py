#!/usr/bin/env python3
# SPDX-License-Identifier: GPL-3.0-or-later
"""A notched block as images with all frames: displacements in the world have to be the same.

usage: image_frames.py [--efree PROGRAM] [--out DIR]      (needs: pip install SimpleITK nibabel)

48 frames whose axes are exchanged and reversed, and 5 that are turned, as NRRD, MetaImage and NIfTI (SimpleITK, whose
world is LPS) and NIfTI (nibabel). Loads, supports and probes are in the world's axes; those of turned frames are turned with the body, on
cells and on a mesh. Prints the largest difference of a displacement over the largest displacement by format, and
fails above 1e-6; a sheared frame has to be refused.
"""
import argparse
import itertools
import json
import pathlib
import subprocess
import sys

import nibabel
import numpy
import SimpleITK

EDGES = numpy.array([0.5, 1.0, 0.75])
FIRST = numpy.array([3.0, -2.0, 1.5])  # centre of the first voxel
PROBES = numpy.array([[14.2, 3.0, 4.0], [5.0, 1.5, 5.5], [12.0, 12.0, 9.0]])
LOAD = numpy.array([0.3, -0.2, -1.0])


def block():
    labels = numpy.ones((24, 16, 12), numpy.uint8)
    labels[8:13, 10:, :] = 0
    labels[:, :4, 9:] = 0
    return labels


def in_frame(labels, order, signs):
    """The array, its directions (columns) and the centre of its first voxel, for axes in this order, with these signs.
    """
    array = labels.transpose(order)
    first, directions = FIRST.copy(), numpy.zeros((3, 3))
    for axis, (world, sign) in enumerate(zip(order, signs)):
        directions[world, axis] = sign
        if sign < 0:
            array = numpy.flip(array, axis)
            first[world] += (labels.shape[world] - 1) * EDGES[world]
    return array, directions, EDGES[list(order)], first


def write(path, array, directions, edges, first):
    if path.name.endswith(".nii.gz") and not path.name.endswith(".itk.nii.gz"):
        affine = numpy.eye(4)
        affine[:3, :3] = directions * edges
        affine[:3, 3] = first
        image = nibabel.Nifti1Image(array, affine)
        image.set_sform(affine, 1)
        nibabel.save(image, str(path))
        return
    image = SimpleITK.GetImageFromArray(numpy.ascontiguousarray(array.transpose(2, 1, 0)))
    image.SetSpacing([float(e) for e in edges])
    image.SetOrigin([float(x) for x in first])
    image.SetDirection([float(d) for d in directions.ravel()])
    SimpleITK.WriteImage(image, str(path))


def solved(program, image, turn, kind):
    """Displacements of the probes in the world, loads and probes turned about the world's origin."""
    folder = image.parent
    case = folder / "case.toml"
    listed = lambda x: "[" + ", ".join(repr(float(v)) for v in x) + "]"
    probes = "".join(f'\n[[probe]]\nname = "p{k}"\nat = {listed(turn @ at)}\n' for k, at in enumerate(PROBES))
    case.write_text(f"""[geometry]
file = "{image.name}"
mesh_size = 1.0
{'image = { world = "LPS" }' if image.name.endswith(".itk.nii.gz") else ""}
[basis]
kind = "{kind}"
[material]
E = 1000
nu = 0.3
[[boundary]]
on = "left"
displacement = [0, 0, 0]
[[boundary]]
on = "top"
normal_displacement = 0
[[boundary]]
on = "right"
traction = {listed(turn @ LOAD)}
{probes}""")
    done = subprocess.run([program, "solve", str(case), "--out", str(folder / "out"), "--no-picture", "--quiet"],
                          capture_output=True, text=True)
    if done.returncode != 0:
        return done.stdout + done.stderr
    probes = json.loads((folder / "out" / "result.json").read_text())["probes"]
    return numpy.array([probes[f"p{k}"]["displacement"] for k in range(len(PROBES))])


def rotation(axis, degrees):
    a = numpy.array(axis) / numpy.linalg.norm(axis)
    k = numpy.array([[0, -a[2], a[1]], [a[2], 0, -a[0]], [-a[1], a[0], 0]])
    angle = numpy.radians(degrees)
    return numpy.eye(3) + numpy.sin(angle) * k + (1 - numpy.cos(angle)) * k @ k


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--efree", default="build/efree")
    parser.add_argument("--out", default="frames", type=pathlib.Path)
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    labels = block()
    reference = {}
    failed = False
    turns = [rotation([0, 0, 1], 20), rotation([1, 0, 0], 35), rotation([1, 1, 1], 10), rotation([1, -2, 3], 40),
             rotation([0, 1, 0.2], -25)]
    for ending in (".nrrd", ".mha", ".nii.gz", ".itk.nii.gz"):
        image = options.out / ("block" + ending)
        for what in ("48 exchanged and reversed, cells", "5 turned, cells", "5 turned, mesh"):
            kind = "p1" if what.endswith("mesh") else "cells"
            if kind not in reference:
                write(image, labels, numpy.eye(3), EDGES, FIRST)
                reference[kind] = solved(options.efree, image, numpy.eye(3), kind)
                if isinstance(reference[kind], str):
                    sys.exit(reference[kind])
            frames = []
            if what.startswith("48"):
                for order in itertools.permutations(range(3)):
                    for signs in itertools.product((1, -1), repeat=3):
                        frames.append((in_frame(labels, order, signs), numpy.eye(3)))
            else:
                for turn in turns:
                    frames.append(((labels, turn, EDGES, turn @ FIRST), turn))
            worst = 0.0
            for frame, turn in frames:
                write(image, *frame)
                found = solved(options.efree, image, turn, kind)
                if isinstance(found, str):
                    sys.exit(f"{ending}, {what}: {found}")
                wanted = reference[kind] @ turn.T
                worst = max(worst, numpy.abs(found - wanted).max() / numpy.abs(wanted).max())
            bad = not worst < 1e-6
            failed |= bad
            print(f"{ending:11} {what:32} largest difference {worst:.1e}{'  above 1e-6' if bad else ''}", flush=True)
    sheared = numpy.eye(3)
    sheared[0, 1] = 0.2
    image = options.out / "block.nii.gz"
    write(image, labels, sheared, EDGES, FIRST)
    refused = solved(options.efree, image, numpy.eye(3), "cells")
    failed |= not isinstance(refused, str) or "right angles" not in refused
    print("sheared:", refused.strip() if isinstance(refused, str) else "not refused")
    sys.exit(1 if failed else 0)


if __name__ == "__main__":
    main()
