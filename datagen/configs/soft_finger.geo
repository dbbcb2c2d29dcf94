// A finger of a soft gripper, 88 x 20 x 16 mm, in hexahedra: five notches across its back, which air cushions
// press open, and a round tip. Lengths in m. The physical groups are what the case file names: the support,
// and the walls of the notches.
//
// The profile in the plane y = 0 has two rows of blocks, belly and back. Every other column of the back is a
// notch. The profile is extruded over the width.
belly = 0.011; height = 0.016; width = 0.020; radius = height / 2; centre = 0.080;
x[] = {0, 0.012, 0.016, 0.026, 0.030, 0.040, 0.044, 0.054, 0.058, 0.068, 0.072, 0.076};
along[] = {8, 4, 8, 4, 8, 4, 8, 4, 8, 4, 3, 4}; across[] = {5, 3}; through = 5; // numbers of cells
z[] = {0, belly, height};
last = #x[] - 1; // column of the round tip

For j In {0:2}
  For i In {0:last}
    Point(100 * j + i) = {x[i], 0, z[j]};
  EndFor
  Point(100 * j + last + 1) = {centre + Sqrt(Fabs(radius^2 - (z[j] - radius)^2)), 0, z[j]};
EndFor
Point(999) = {centre, 0, radius};
For j In {0:2}
  For i In {0:last}
    Line(1000 + 100 * j + i) = {100 * j + i, 100 * j + i + 1};
    Transfinite Curve{1000 + 100 * j + i} = along[i] + 1;
  EndFor
EndFor
For j In {0:1}
  For i In {0:last}
    Line(2000 + 100 * j + i) = {100 * j + i, 100 * j + i + 100};
  EndFor
  Circle(2000 + 100 * j + last + 1) = {100 * j + last + 1, 999, 100 * j + last + 101};
  For i In {0:last + 1}
    Transfinite Curve{2000 + 100 * j + i} = across[j] + 1;
  EndFor
EndFor
For j In {0:1}
  For i In {0:last}
    block = 3000 + 100 * j + i;
    Curve Loop(block) = {1000 + 100 * j + i, 2000 + 100 * j + i + 1, -(1100 + 100 * j + i), -(2000 + 100 * j + i)};
    Plane Surface(block) = {block};
    Transfinite Surface{block};
    Recombine Surface{block};
  EndFor
EndFor

finger[] = {}; clamped[] = {}; notches[] = {};
For j In {0:1}
  For i In {0:last}
    is_notch = i < last - 1 && i % 2 == 1;
    If (j == 0 || !is_notch)
      made[] = Extrude{0, width, 0}{ Surface{3000 + 100 * j + i}; Layers{through}; Recombine; };
      finger[] += made[1]; // then the walls below, right, above and left of the block
      If (i == 0)
        clamped[] += made[5];
      EndIf
      If (j == 0 && is_notch)
        notches[] += made[4];
      EndIf
      If (j == 1 && i < last - 1)
        notches[] += made[3];
      EndIf
      If (j == 1 && i > 0 && i < last)
        notches[] += made[5];
      EndIf
    EndIf
  EndFor
EndFor
Physical Volume("finger") = {finger[]};
Physical Surface("clamped") = {clamped[]};
Physical Surface("notches") = {notches[]};
