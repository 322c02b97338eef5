"""What contact models written in C share: the model around a kernel, its pressures, and the C that each is made of."""

from casadi_contact.contact.compiled.foundation import CompiledFoundation
from casadi_contact.contact.compiled.pressures import CompiledPressures

__all__ = ["CompiledFoundation", "CompiledPressures"]
