"""What touches what, of which material, under which loads; cycles, poses and OpenSim files."""
