// A soft actuator that bends, 100 x 20 x 16 mm, in hexahedra: three closed chambers above a stiffer layer. Lengths
// in m. The physical groups are what the case file names: materials, the support, and the walls of the chambers.
//
// The profile in the plane y = 0 has seven columns and four rows of blocks: stiff layer, floor, chambers, roof. It is
// extruded over the width in three parts: side wall, chambers, side wall.
x[] = {0, 0.006, 0.030, 0.038, 0.062, 0.070, 0.094, 0.100};
z[] = {0, 0.003, 0.005, 0.013, 0.016};
width[] = {0.003, 0.014, 0.003};
along[] = {2, 6, 2, 6, 2, 6, 2}; across[] = {2, 1, 4, 2}; through[] = {2, 4, 2}; // numbers of cells

For k In {0:4}
  For i In {0:7}
    Point(100 * k + i) = {x[i], 0, z[k]};
  EndFor
EndFor
For k In {0:4}
  For i In {0:6}
    Line(1000 + 100 * k + i) = {100 * k + i, 100 * k + i + 1};
    Transfinite Curve{1000 + 100 * k + i} = along[i] + 1;
  EndFor
EndFor
For k In {0:3}
  For i In {0:7}
    Line(2000 + 100 * k + i) = {100 * k + i, 100 * k + i + 100};
    Transfinite Curve{2000 + 100 * k + i} = across[k] + 1;
  EndFor
EndFor
For k In {0:3}
  For i In {0:6}
    block = 3000 + 100 * k + i;
    Curve Loop(block) = {1000 + 100 * k + i, 2000 + 100 * k + i + 1, -(1100 + 100 * k + i), -(2000 + 100 * k + i)};
    Plane Surface(block) = {block};
    Transfinite Surface{block};
    Recombine Surface{block};
  EndFor
EndFor

soft[] = {}; stiff[] = {}; clamped[] = {}; walls[] = {}; chambers[] = {};
For k In {0:3}
  For i In {0:6}
    below = 3000 + 100 * k + i;
    For j In {0:2}
      // made: the surface behind, the volume, then the walls below, right, above and left of the block
      made[] = Extrude{0, width[j], 0}{ Surface{below}; Layers{through[j]}; Recombine; };
      If (k == 2 && j == 1 && i % 2 == 1)
        chambers[] += made[1];
        walls[] += {below, made[0], made[2], made[3], made[4], made[5]};
      ElseIf (k == 0)
        stiff[] += made[1];
      Else
        soft[] += made[1];
      EndIf
      If (i == 0)
        clamped[] += made[5];
      EndIf
      below = made[0];
    EndFor
  EndFor
EndFor
Delete{ Volume{chambers[]}; }
Physical Volume("soft") = {soft[]};
Physical Volume("stiff") = {stiff[]};
Physical Surface("clamped") = {clamped[]};
Physical Surface("root") = {walls[{0:5}]};
Physical Surface("middle") = {walls[{6:11}]};
Physical Surface("tip") = {walls[{12:17}]};
