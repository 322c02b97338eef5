"""Polar quadrature: smooth surfaces with one spot of contact a patch, and another on its rim, integrated on rays."""
