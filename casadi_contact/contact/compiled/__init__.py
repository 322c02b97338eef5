"""What contact models written in C share: the model around a kernel, its pressures, and the C that each is made of."""
