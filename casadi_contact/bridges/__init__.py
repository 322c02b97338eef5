"""Contact models inside other libraries: each bridge imports its library, which nothing else does."""
