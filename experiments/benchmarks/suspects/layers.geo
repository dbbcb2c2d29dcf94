L=4; h=0.25;
Point(1)={0,0,0,1};Point(2)={L,0,0,1};Point(3)={0,h,0,1};Point(4)={L,h,0,1};Point(5)={0,3*h,0,1};Point(6)={L,3*h,0,1};Point(7)={0,4*h,0,1};Point(8)={L,4*h,0,1};
Line(1)={1,2};Line(2)={3,4};Line(3)={5,6};Line(4)={7,8};Line(5)={1,3};Line(6)={3,5};Line(7)={5,7};Line(8)={2,4};Line(9)={4,6};Line(10)={6,8};
Curve Loop(1)={1,8,-2,-5};Plane Surface(1)={1};Curve Loop(2)={2,9,-3,-6};Plane Surface(2)={2};Curve Loop(3)={3,10,-4,-7};Plane Surface(3)={3};
Physical Surface("stiff")={1,3};Physical Surface("soft")={2};
Transfinite Curve{1,2,3,4}=25;Transfinite Curve{5,7,8,10}=3;Transfinite Curve{6,9}=4;Transfinite Surface{1,2,3};Recombine Surface{1,2,3};
