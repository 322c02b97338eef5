"""A ball in a spherical cup: quadrature over one angle, the rest in closed form."""
