"""Compiled kernels: one small C file per surrogate, with structured first and second derivatives."""
