"""Verification: is the solution that a surrogate led to one of the contact model as well, and if not, refine."""
