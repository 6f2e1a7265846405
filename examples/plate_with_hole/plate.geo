// SPDX-License-Identifier: GPL-3.0-or-later
// A quarter of a square plate with a circular hole.
//
//        top
//    +---------+
//    |         |
//    |left     | right
//    |         |
//    +-,       |
//   hole \     |
//         +----+
//         bottom
//
SetFactory("Built-in");
radius = DefineNumber[1, Name "radius"];
half_width = DefineNumber[4, Name "half_width"];

Point(1) = {0, 0, 0};
Point(2) = {radius, 0, 0};
Point(3) = {half_width, 0, 0};
Point(4) = {half_width, half_width, 0};
Point(5) = {0, half_width, 0};
Point(6) = {0, radius, 0};

Line(1) = {2, 3};
Line(2) = {3, 4};
Line(3) = {4, 5};
Line(4) = {5, 6};
Circle(5) = {6, 1, 2};
Curve Loop(1) = {1, 2, 3, 4, 5};
Plane Surface(1) = {1};

Physical Curve("bottom") = {1};
Physical Curve("right") = {2};
Physical Curve("top") = {3};
Physical Curve("left") = {4};
Physical Curve("hole") = {5};
Physical Surface("plate") = {1};
