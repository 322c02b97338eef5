"""Shapes: one record for each, from the checks of its [geometry] to its surfaces and elements."""
