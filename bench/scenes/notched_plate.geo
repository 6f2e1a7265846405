// A plate 40 by 20 with a round notch of radius 4 in either side.
SetFactory("OpenCASCADE");
Rectangle(1) = {0, 0, 0, 20, 40};
Disk(2) = {0, 20, 0, 4};
Disk(3) = {20, 20, 0, 4};
BooleanDifference{ Surface{1}; Delete; }{ Surface{2, 3}; Delete; }
Physical Surface("plate") = {1};
eps = 1e-3;
Physical Curve("bottom") = Curve In BoundingBox{-eps, -eps, -eps, 20 + eps, eps, eps};
Physical Curve("top") = Curve In BoundingBox{-eps, 40 - eps, -eps, 20 + eps, 40 + eps, eps};
