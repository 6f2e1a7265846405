// A cell of a hexagonal array of fibres of unit spacing: one fibre in the middle, quarters of four at the corners.
SetFactory("OpenCASCADE");
DefineConstant[ fraction = {0.6, Name "fraction"} ];
height = Sqrt(3.0);
radius = Sqrt(0.5 * fraction * height / Pi);
Rectangle(1) = {0, 0, 0, 1, height};
Disk(2) = {0.5, 0.5 * height, 0, radius};
Disk(3) = {0, 0, 0, radius};
Disk(4) = {1, 0, 0, radius};
Disk(5) = {1, height, 0, radius};
Disk(6) = {0, height, 0, radius};
fibres() = BooleanIntersection{ Surface{1}; }{ Surface{2:6}; Delete; };
matrix() = BooleanDifference{ Surface{1}; Delete; }{ Surface{fibres()}; };
BooleanFragments{ Surface{matrix(), fibres()}; Delete; }{ }
Physical Surface("fibres") = {fibres()};
Physical Surface("matrix") = {matrix()};
