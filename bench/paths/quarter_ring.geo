// SPDX-License-Identifier: GPL-3.0-or-later
// A quarter of a ring of radii 100 and 200; as a section of revolution half a sphere.
SetFactory("OpenCASCADE");
Disk(1) = {0, 0, 0, 200};
Disk(2) = {0, 0, 0, 100};
BooleanDifference(3) = { Surface{1}; Delete; }{ Surface{2}; Delete; };
Rectangle(4) = {0, 0, 0, 300, 300};
BooleanIntersection(5) = { Surface{3}; Delete; }{ Surface{4}; Delete; };
e = 0.01;
Physical Curve("left") = Curve In BoundingBox {-e, -e, -e, e, 200 + e, e};
Physical Curve("bottom") = Curve In BoundingBox {-e, -e, -e, 200 + e, e, e};
Physical Curve("inner") = Curve In BoundingBox {-e, -e, -e, 100 + e, 100 + e, e};
Physical Curve("outer") = Curve In BoundingBox {-e, -e, -e, 200 + e, 200 + e, e};
Physical Surface("ring") = Surface{:};
Mesh.MeshSizeFromCurvature = 40;
Mesh.MeshSizeMax = 12;
