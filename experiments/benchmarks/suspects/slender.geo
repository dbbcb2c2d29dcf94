SetFactory("OpenCASCADE");
Box(1)={0,0,0,4,0.6,0.6};
Mesh.MeshSizeMax=0.35;
