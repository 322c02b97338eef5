"""The elastic foundation as a sum over flat elements: numba's loops, and C for the parametric shapes."""
