"""Pressure of a contact model: its laws, its map over the fixed surface, and what is summed up of it."""
