"""What the problems share: the command line, results as files, pages of pictures."""
