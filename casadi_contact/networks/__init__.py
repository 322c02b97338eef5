"""A network: its derivatives, its CasADi graph and its C; Levenberg-Marquardt."""
