// SPDX-License-Identifier: GPL-3.0-or-later
// Half of a circular arch, of radius 100 in its middle, 1 thick, with an opening angle of 0.25 to either side.
SetFactory("Built-in");
h = DefineNumber[1, Name "Parameters/h"];
a = 0.25;
Point(1) = {0, 0, 0, h};
Point(2) = {0, 99.5, 0, h};
Point(3) = {99.5 * Sin(a), 99.5 * Cos(a), 0, h};
Point(4) = {100.5 * Sin(a), 100.5 * Cos(a), 0, h};
Point(5) = {0, 100.5, 0, h};
Circle(1) = {2, 1, 3}; Line(2) = {3, 4}; Circle(3) = {4, 1, 5}; Line(4) = {5, 2};
Curve Loop(1) = {1, 2, 3, 4};
Plane Surface(1) = {1};
Physical Curve("bottom") = {1}; Physical Curve("abutment") = {2}; Physical Curve("top") = {3}; Physical Curve("crown") = {4};
Physical Surface("arch") = {1};
