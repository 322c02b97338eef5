"""Files: read with bounded sizes and errors of one line, written atomically."""
