// SPDX-License-Identifier: GPL-3.0-or-later
// A tube, radii 0.8 and 1, length 2, with a hole of radius 0.3 in its wall.
SetFactory("OpenCASCADE");
Cylinder(1) = {0, 0, 0, 0, 0, 2, 1};
Cylinder(2) = {0, 0, -1, 0, 0, 4, 0.8};
Cylinder(3) = {0, 0, 1, 0, -2, 0, 0.3};
BooleanDifference{ Volume{1}; Delete; }{ Volume{2, 3}; Delete; }
Physical Volume("shell") = {1};
eps = 1e-3;
Physical Surface("bottom") = Surface In BoundingBox{-2, -2, -eps, 2, 2, eps};
Physical Surface("top") = Surface In BoundingBox{-2, -2, 2 - eps, 2, 2, 2 + eps};
