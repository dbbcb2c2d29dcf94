// The beam with a thin part at the upper edge of its tip that has the mass of the weight; hexahedra, lengths in m.
x[] = {-0.1, -0.001, 0};
z[] = {0, 0.025, 0.03};
along[] = {20, 1}; across[] = {5, 1};
For k In {0:2}
  For i In {0:2}
    Point(10 * k + i) = {x[i], 0, z[k]};
  EndFor
EndFor
For k In {0:2}
  For i In {0:1}
    Line(100 + 10 * k + i) = {10 * k + i, 10 * k + i + 1};
    Transfinite Curve{100 + 10 * k + i} = along[i] + 1;
  EndFor
EndFor
For k In {0:1}
  For i In {0:2}
    Line(200 + 10 * k + i) = {10 * k + i, 10 * k + i + 10};
    Transfinite Curve{200 + 10 * k + i} = across[k] + 1;
  EndFor
EndFor
beam[] = {}; clamped[] = {};
For k In {0:1}
  For i In {0:1}
    block = 300 + 10 * k + i;
    Curve Loop(block) = {100 + 10 * k + i, 200 + 10 * k + i + 1, -(110 + 10 * k + i), -(200 + 10 * k + i)};
    Plane Surface(block) = {block};
    Transfinite Surface{block};
    Recombine Surface{block};
    made[] = Extrude{0, 0.03, 0}{ Surface{block}; Layers{6}; Recombine; };
    If (k == 1 && i == 1)
      Physical Volume("edge") = {made[1]};
    Else
      beam[] += made[1];
    EndIf
    If (i == 0)
      clamped[] += made[5];
    EndIf
  EndFor
EndFor
Physical Volume("beam") = {beam[]};
Physical Surface("clamped") = {clamped[]};
