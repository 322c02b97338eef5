"""A network's C kernel, and the CasADi functions made of it."""
