"""Motion: cycles, poses, columns and OpenSim files, everything that is measured over time."""
