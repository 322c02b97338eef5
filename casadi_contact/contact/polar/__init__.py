"""Polar quadrature: smooth surfaces with one spot of contact a patch, integrated on rays from the spot's middle."""
