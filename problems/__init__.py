"""Optimisation problems on contact surrogates, each with build(...), solve(...) and main()."""
