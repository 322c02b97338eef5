"""From plain networks to CasADi functions with exact, cheap first and second derivatives, and to C."""
