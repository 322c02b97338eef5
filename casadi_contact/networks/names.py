"""Names of functions and files that C and CasADi accept, and text that is harmless in a C comment."""

import ctypes
import re
from collections.abc import Iterable

import casadi as ca

_IDENTIFIER = re.compile(r"[A-Za-z_][A-Za-z0-9_]{0,99}")
_NOT_FOR_NAMES = re.compile(r"[^A-Za-z0-9]+")
_NOT_FOR_COMMENTS = re.compile(r"[^A-Za-z0-9 _.,;:()/+=<>-]")  # no * that could end one, no ?, \ or line break


def identifier(name: str) -> str:
    """The name, if C takes it for one; raises ValueError otherwise: it could be code."""
    if not _IDENTIFIER.fullmatch(name):
        raise ValueError(f"{name!r} cannot be a name in C, expected up to 100 ASCII letters, digits and underscores")
    return name


def c_name(text: str) -> str:
    """Words, or the name of a file, as a name in C and CasADi: letters, digits and single underscores.

    >>> c_name("my-knee.2 contact")
    'my_knee_2_contact'
    """
    return identifier(_NOT_FOR_NAMES.sub("_", text))


def comment_text(text: str) -> str:
    """The text in ASCII: x for ×, and _ for every character that could end a comment or hide its end.

    >>> comment_text("knee **" + "// exit(1);")
    'knee __// exit(1);'
    >>> comment_text("16 rays × 3 points")
    '16 rays x 3 points'
    """
    return _NOT_FOR_COMMENTS.sub("_", text.replace("×", "x"))


_OF_C = (  # and of C++, whose programs include the header; last, macros of compilers and of C's headers
    "alignas alignof and and_eq asm auto bitand bitor bool break case catch char class compl concept const "
    "const_cast constexpr continue decltype default delete do double dynamic_cast else enum explicit export "
    "extern false float for friend goto if inline int long main mutable namespace new noexcept not not_eq nullptr "
    "operator or or_eq private protected public register reinterpret_cast requires restrict return short signed "
    "sizeof static static_assert static_cast struct switch template this thread_local throw true try typedef "
    "typeid typename typeof union unsigned using virtual void volatile wchar_t while xor xor_eq "
    "linux unix EOF INFINITY NAN NULL fpclassify isfinite isnormal signbit"
)
RESERVED_NAMES = frozenset(("jac", "hess", "null", *_OF_C.split()))
_DECLARED = re.compile(r"^(?:[A-Za-z_][^\n(\[=;]*[\s*]|#define\s+)(\w+)", re.MULTILINE)  # at file scope of our C
_C_LIBRARY = ctypes.CDLL(None)
_GIVEN = ("loads", "roots", "loads_and_roots", "validity", "expected_error", "pressures")
DEFAULT_NAMES = tuple(f"contact_{given}{frames}" for given in _GIVEN for frames in ("", "_of_frames"))
"""Names of functions where none is asked for."""


def check_name(name: str) -> str:
    """A name that CasADi and C accept; raises ValueError otherwise."""
    if not name.isascii() or not ca.Function.check_name(name) or name in RESERVED_NAMES:
        expected = "letters, digits and single underscores, and no word of C"
        raise ValueError(f"function name {name!r} is not usable, expected {expected}")
    return name


def check_unused(name: str, source: str, *, suffixes: Iterable[str] = ("",)) -> None:
    """ValueError for a name that the C library has (types end in _t), or, with such a suffix, C source itself."""
    named = {f"{name}{suffix}" for suffix in suffixes}
    of_c = name.endswith("_t") or (name not in DEFAULT_NAMES and hasattr(_C_LIBRARY, name))
    if of_c or named & set(_DECLARED.findall(source)):
        raise ValueError(f"function name {name!r} is not usable, C or the C of contact models has it: choose another")


def name_of_batch(name: str, batch: int) -> str:
    """The name of a function of several poses: code that CasADi generates must not find that of one pose under it."""
    return name if batch == 1 else f"{name}_of_frames"


def name_of_wrenches(name: str) -> str:
    """The name of the function of all patches' wrenches, of which `name` with parameters makes loads."""
    return f"{name}_patch_wrenches"
