"""Speed against accuracy, of every model in one run on one thread; errors by domain [EF15 §2.7, Tables 2 to 4]."""
