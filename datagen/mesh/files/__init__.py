"""Files of meshes, surfaces and CAD, each read into a `datagen.mesh.raw_mesh.RawMesh`.

================  ===============================================================
`gmsh_file`       gmsh scripts, and gmsh meshes from format 4
`msh2_file`       gmsh meshes of format 2
`abaqus_file`     Abaqus input, with its parts and instances
`cad_file`        STEP, IGES and BREP
`surface_file`    the inside of closed surfaces (STL, OBJ, PLY)
`meshio_file`     all other formats
================  ===============================================================
"""
