"""Samples, training and calibration in a row; presets, benchmark, refinement, scenes from meshes."""
