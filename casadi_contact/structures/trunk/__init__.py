"""The trunk structure: the patch structure with one network for all ratios of a patch."""
