// SPDX-License-Identifier: GPL-3.0-or-later
// An eighth of a bar of circular section along z, 1.8 % thinner in its middle (z = 0).
//
//   top, z = 26.667        section in y = 0:   4 ------ 3
//   middle, z = 0                              |axis    | side
//   front, y = 0, left, x = 0                  1 ----- 2
//
SetFactory("Built-in");
radius = DefineNumber[6.413, Name "radius"];
half_length = DefineNumber[26.667, Name "half_length"];

Point(1) = {0, 0, 0};
Point(2) = {0.982 * radius, 0, 0};
Point(3) = {radius, 0, half_length};
Point(4) = {0, 0, half_length};
Line(1) = {1, 2};
Line(2) = {2, 3};
Line(3) = {3, 4};
Line(4) = {4, 1};
Curve Loop(1) = {1, 2, 3, 4};
Plane Surface(1) = {1};
turned[] = Extrude { {0, 0, 1}, {0, 0, 0}, Pi / 2 } { Surface{1}; };

Physical Surface("front") = {1};
Physical Surface("left") = {turned[0]};
Physical Surface("middle") = {turned[2]};
Physical Surface("side") = {turned[3]};
Physical Surface("top") = {turned[4]};
Physical Volume("bar") = {turned[1]};
