"""Contact in optimisation problems, assemblies of contacts, verification of solutions."""
