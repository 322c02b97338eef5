"""OpenSim's motion and storage files, and how their columns become poses and loads."""
