"""Contact models inside other libraries: each bridge imports its library, which no other room does."""
