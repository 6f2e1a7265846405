// Two discs of radius 0.2, 0.1 apart.
SetFactory("OpenCASCADE");
Disk(1) = {-0.25, 0.013, 0, 0.2};
Disk(2) = {0.25, 0.013, 0, 0.2};
Physical Surface("left") = {1};
Physical Surface("right") = {2};
