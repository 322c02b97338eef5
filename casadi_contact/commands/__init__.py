"""The commands of ``casadi-contact``, each a function whose parameters are its arguments and options."""
