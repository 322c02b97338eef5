"""Bodies on joints or free, and what acts between them: contacts, ligaments, muscles, springs on coordinates."""

from casadi_contact.optimisation.assembly.jointed import JointedAssembly as Assembly

__all__ = ["Assembly"]
