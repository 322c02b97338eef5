"""Contact models: pose of the moving body in, loads on the fixed body out; static equilibrium."""
