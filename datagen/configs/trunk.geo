// A trunk, 300 mm long, whose radius falls from 30 to 15 mm, in hexahedra. Lengths in m. The physical groups are what
// the case file names.
//
// Its disc at z = 0, and that at its tip, have a square core and four blocks around it.
radius[] = {0.030, 0.015}; height[] = {0, 0.300}; core = 0.5;
around = 4; outwards = 2; along = 40; // numbers of cells of a block

For e In {0:1}
  Point(100 * e + 50) = {0, 0, height[e]};
  For q In {0:3}
    c = Cos(Pi / 4 + q * Pi / 2); s = Sin(Pi / 4 + q * Pi / 2);
    Point(100 * e + q) = {core * radius[e] * c, core * radius[e] * s, height[e]};
    Point(100 * e + 10 + q) = {radius[e] * c, radius[e] * s, height[e]};
  EndFor
  For q In {0:3}
    next = (q + 1) % 4;
    Line(1000 + 100 * e + q) = {100 * e + q, 100 * e + next};
    Line(1010 + 100 * e + q) = {100 * e + q, 100 * e + 10 + q};
    Circle(1020 + 100 * e + q) = {100 * e + 10 + q, 100 * e + 50, 100 * e + 10 + next};
    Transfinite Curve{1000 + 100 * e + q, 1020 + 100 * e + q} = around + 1;
    Transfinite Curve{1010 + 100 * e + q} = outwards + 1;
  EndFor
EndFor
For q In {0:3}
  Line(1300 + q) = {q, 100 + q};
  Line(1310 + q) = {10 + q, 110 + q};
  Transfinite Curve{1300 + q, 1310 + q} = along + 1;
EndFor
For e In {0:1}
  Curve Loop(2000 + 100 * e) = {1000 + 100 * e, 1001 + 100 * e, 1002 + 100 * e, 1003 + 100 * e};
  Plane Surface(2000 + 100 * e) = {2000 + 100 * e};
  For q In {0:3}
    next = (q + 1) % 4; f = 100 * e;
    Curve Loop(2010 + f + q) = {1000 + f + q, 1010 + f + next, -(1020 + f + q), -(1010 + f + q)};
    Plane Surface(2010 + f + q) = {2010 + f + q};
  EndFor
EndFor
For q In {0:3}
  next = (q + 1) % 4;
  Curve Loop(2300 + q) = {1000 + q, 1300 + next, -(1100 + q), -(1300 + q)};
  Curve Loop(2310 + q) = {1010 + q, 1310 + q, -(1110 + q), -(1300 + q)};
  Curve Loop(2320 + q) = {1020 + q, 1310 + next, -(1120 + q), -(1310 + q)};
  Surface(2300 + q) = {2300 + q};
  Surface(2310 + q) = {2310 + q};
  Surface(2320 + q) = {2320 + q};
EndFor
Surface Loop(3000) = {2000, 2100, 2300, 2301, 2302, 2303};
Volume(3000) = {3000};
For q In {0:3}
  Surface Loop(3001 + q) = {2010 + q, 2110 + q, 2300 + q, 2320 + q, 2310 + q, 2310 + (q + 1) % 4};
  Volume(3001 + q) = {3001 + q};
EndFor
Transfinite Surface{:};
Recombine Surface{:};
Transfinite Volume{:};

Physical Volume("trunk") = {3000:3004};
Physical Surface("clamped") = {2000, 2010:2013};
Physical Surface("end") = {2100, 2110:2113};
