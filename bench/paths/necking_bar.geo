// SPDX-License-Identifier: GPL-3.0-or-later
// Half of the section of a bar of circular section along y, 1.8 % thinner in its middle (y = 0).
h = DefineNumber[1.3, Name "Parameters/h"];
Point(1) = {0, 0, 0, h};
Point(2) = {6.297566, 0, 0, h};
Point(3) = {6.413, 26.667, 0, h};
Point(4) = {0, 26.667, 0, h};
Line(1) = {1, 2}; Line(2) = {2, 3}; Line(3) = {3, 4}; Line(4) = {4, 1};
Curve Loop(1) = {1, 2, 3, 4};
Plane Surface(1) = {1};
Physical Curve("middle") = {1}; Physical Curve("side") = {2}; Physical Curve("top") = {3}; Physical Curve("axis") = {4};
Physical Surface("bar") = {1};
