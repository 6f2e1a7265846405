// A layer of soil on a slope of 33.7 degrees. m.
Point(1) = {1, 7.333333333, 0};
Point(2) = {8, 2.666666667, 0};
Point(3) = {7.2, 4.6, 0};
Point(4) = {3.2, 7.3, 0};
Line(1) = {1, 2};
Line(2) = {2, 3};
Line(3) = {3, 4};
Line(4) = {4, 1};
Curve Loop(1) = {1, 2, 3, 4};
Plane Surface(1) = {1};
Physical Surface("soil") = {1};
