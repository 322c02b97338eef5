"""Units, names and frames; files; the C compiler and its cache; workers, progress and the terminal."""
