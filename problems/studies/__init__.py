"""Studies of methods rather than of a joint: where they fail, how long a step may be, how far refinement carries."""
