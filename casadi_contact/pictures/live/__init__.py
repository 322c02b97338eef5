"""The joint in a page: its kernel as WebAssembly, the bodies in 3-D, sliders, loads and a cycle, in one HTML file."""
