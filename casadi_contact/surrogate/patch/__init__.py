"""The default structure: a root and ratios for every patch."""
