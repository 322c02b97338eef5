"""Assemblies: several contacts, ligaments and springs between bodies, as one CasADi function of all their poses."""
