// SPDX-License-Identifier: GPL-3.0-or-later
// Cook's membrane (Cook 1974): clamped on the left, sheared on the right.
//
//                  + (48, 60)
//           .  '   | right
//   (0,44) +       + (48, 44)
//     left |    .
//          |  .
//    (0,0) +
//
SetFactory("Built-in");
Point(1) = {0, 0, 0};
Point(2) = {48, 44, 0};
Point(3) = {48, 60, 0};
Point(4) = {0, 44, 0};
Line(1) = {1, 2};
Line(2) = {2, 3};
Line(3) = {3, 4};
Line(4) = {4, 1};
Curve Loop(1) = {1, 2, 3, 4};
Plane Surface(1) = {1};
Physical Curve("bottom") = {1};
Physical Curve("right") = {2};
Physical Curve("top") = {3};
Physical Curve("left") = {4};
Physical Surface("membrane") = {1};
