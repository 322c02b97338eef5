"""Cubic cells: any two surfaces with several spots of contact, the gap interpolated between nodes."""
