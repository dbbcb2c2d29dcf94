SetFactory("OpenCASCADE");
Rectangle(1)={0,0,0,4,1};
Mesh.MeshSizeMax=0.28;
