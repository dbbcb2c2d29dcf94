// A plate of 4 x 1.6 m with three holes, in triangles; place and radius of the middle one are constants. Lengths in m.
SetFactory("OpenCASCADE");
DefineConstant[ x = 2.1, radius = 0.45 ];
Rectangle(1) = {0, 0, 0, 4, 1.6};
Disk(2) = {0.9, 0.8, 0, 0.4};
Disk(3) = {x, 0.8, 0, radius};
Disk(4) = {3.2, 0.8, 0, 0.35};
BooleanDifference(10) = { Surface{1}; Delete; }{ Surface{2, 3, 4}; Delete; };

Physical Surface("plate") = {10};
Physical Curve("clamped") = Curve In BoundingBox{-0.01, -0.01, -1, 0.01, 1.61, 1};
Physical Curve("loaded") = Curve In BoundingBox{3.99, -0.01, -1, 4.01, 1.61, 1};

Mesh.MeshSizeMax = 0.16;
Mesh.MeshSizeMin = 0.16;
