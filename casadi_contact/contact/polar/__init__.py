"""Polar quadrature: smooth surfaces with one contact area a patch, and another on its rim, integrated on rays."""
