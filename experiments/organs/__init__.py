"""Studies of the liver and the breast, whose meshes the paper's authors published."""
