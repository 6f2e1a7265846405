// SPDX-License-Identifier: GPL-3.0-or-later
// Half of a strip footing, 50 wide, on soil 500 wide and deep; the mesh is dense under its edge.
h = DefineNumber[40, Name "Parameters/h"];
hf = DefineNumber[2.5, Name "Parameters/hf"];
Point(1) = {0,0,0,h};
Point(2) = {500,0,0,h};
Point(3) = {500,500,0,h};
Point(4) = {50,500,0,hf};
Point(5) = {0,500,0,hf*2};
Line(1) = {1,2}; Line(2) = {2,3}; Line(3) = {3,4}; Line(4) = {4,5}; Line(5) = {5,1};
Curve Loop(1) = {1,2,3,4,5}; Plane Surface(1) = {1};
Physical Curve("base") = {1}; Physical Curve("far") = {2}; Physical Curve("footing") = {4}; Physical Curve("axis") = {5};
Physical Surface("soil") = {1};
Mesh.MeshSizeExtendFromBoundary = 1;
