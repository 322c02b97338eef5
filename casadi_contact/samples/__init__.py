"""Samples of a contact model: domains D1 to D7, drawing, the file."""
