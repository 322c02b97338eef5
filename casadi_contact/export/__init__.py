"""Contact models in other programs: C, MEX, FMU, PyTorch, JAX."""
