"""An OpenSim or JAM model file becomes an assembly: `casadi-contact import model.osim --out my_knee`."""
