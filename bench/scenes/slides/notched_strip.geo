// SPDX-License-Identifier: GPL-3.0-or-later
// A strip 2 by 1 with a notch in its upper side.
SetFactory("OpenCASCADE");
Rectangle(1) = {0, 0, 0, 2, 1};
Rectangle(2) = {0.95, 0.7, 0, 0.1, 1};
BooleanDifference{ Surface{1}; Delete; }{ Surface{2}; Delete; }
Physical Surface("strip") = {1};
eps = 1e-3;
Physical Curve("left") = Curve In BoundingBox{-eps, -eps, -eps, eps, 1 + eps, eps};
Physical Curve("right") = Curve In BoundingBox{2 - eps, -eps, -eps, 2 + eps, 1 + eps, eps};
