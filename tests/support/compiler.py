"""Skip where there is no C compiler, and compile with the library's own flags where tests ask for them."""

from contextlib import contextmanager

import pytest

from casadi_contact.core.compiler import CFLAGS_VARIABLE, CompilerError, compiler_command

# At -O3 gcc takes half of the time of all tests. Formulas are the same at -Og, which takes a third of that; some tests
# of every kind of kernel have the library's flags.
QUICK = "-march=native -Og"


@contextmanager
def flags_of_the_library():
    """Kernels compiled meanwhile have the flags that a user gets."""
    with pytest.MonkeyPatch.context() as patch:
        patch.delenv(CFLAGS_VARIABLE, raising=False)
        yield


def _has_compiler() -> bool:
    try:
        compiler_command()
    except CompilerError:
        return False
    return True


needs_compiler = pytest.mark.skipif(not _has_compiler(), reason="no C compiler found")
