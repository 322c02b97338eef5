"""The two bodies as smooth surfaces: meshes, distance fields, elements."""
