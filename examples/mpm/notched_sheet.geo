// SPDX-License-Identifier: GPL-3.0-or-later
// A sheet 30 by 20 with a notch in its left side and a hole to the right of it, somewhat higher.
SetFactory("OpenCASCADE");
Rectangle(1) = {0, 0, 0, 30, 20};
Rectangle(2) = {-1, 9, 0, 7, 1.5};
Disk(3) = {17, 13.5, 0, 2.5};
BooleanDifference{ Surface{1}; Delete; }{ Surface{2, 3}; Delete; }
Physical Surface("sheet") = {1};
eps = 1e-3;
Physical Curve("bottom") = Curve In BoundingBox{-eps, -eps, -eps, 30 + eps, eps, eps};
Physical Curve("top") = Curve In BoundingBox{-eps, 20 - eps, -eps, 30 + eps, 20 + eps, eps};
