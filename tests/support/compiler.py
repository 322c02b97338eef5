"""Skip where there is no C compiler."""

import pytest

from casadi_contact.transcription.kernel.compiler import CompilerError, compiler_command


def _has_compiler() -> bool:
    try:
        compiler_command()
    except CompilerError:
        return False
    return True


needs_compiler = pytest.mark.skipif(not _has_compiler(), reason="no C compiler found")
