// A finger of a soft gripper, 88 x 20 x 16 mm, in tetrahedra: five notches across its back, a round tip.
// Lengths in m. The physical group is what the case file names: its support.
SetFactory("OpenCASCADE");
Box(1) = {0, 0, 0, 0.080, 0.020, 0.016};
Cylinder(2) = {0.080, 0, 0.008, 0, 0.020, 0, 0.008};
BooleanUnion(3) = { Volume{1}; Delete; }{ Volume{2}; Delete; };
For i In {0:4}
  Box(10 + i) = {0.012 + 0.014 * i, -0.001, 0.009, 0.004, 0.022, 0.008};
EndFor
BooleanDifference(20) = { Volume{3}; Delete; }{ Volume{10:14}; Delete; };

Physical Volume("finger") = {20};
Physical Surface("clamped") = Surface In BoundingBox{-0.001, -0.001, -0.001, 0.001, 0.021, 0.017};

Mesh.MeshSizeMax = 0.0026;
Mesh.MeshSizeMin = 0.0026;
