"""CasADi functions in ``.casadi`` files, checked before CasADi reads them.

What CasADi reads may load a library, or compile and run C, and damaged bytes may crash it. Files are therefore written
with the name of every field (CasADi's "debug" form; CasADi refuses fields under another name), so that the class of
every function in the file can be read beforehand, and end in a line with the SHA-256 of all before it. CasADi ignores
that line: ``casadi.Function.load`` reads these files too, in Python, MATLAB and C++.
"""

from __future__ import annotations

import hashlib
from pathlib import Path

import casadi as ca

from casadi_contact.core.files.reading import MOST_DATA, checked_size, existing_file
from casadi_contact.core.files.writing import replacing

_SEAL = b"\nsha256 "
_DIGITS = b"abcdefghijklmnop"  # CasADi writes each byte as two of these, the lower four bits first
_FROM_HEX = bytes.maketrans(_DIGITS, b"0123456789abcdef")
_NAMED_FIELDS = b"\x01"  # the byte after CasADi's magic number and version
_CLASS = b"FunctionInternal::base_function"  # under it stands the kind of every function in the file
_HEAD = 16
_PLAIN = (b"MXFunction", b"SXFunction", b"Map")  # functions that are formulas and nothing else
_BOUND_HERE = (b"External", b"CallbackInternal")  # a library in this user's cache folder, code of this process
_FOREIGN = (b"ImporterInternal::type", b"FmuInternal::type", b"ResourceInternal::type", b"PluginInterface::plugin_name")


def save_function(function: ca.Function, path: str | Path) -> None:
    """Write a ``.casadi`` file that `load_function` (or casadi.Function.load) reads, derivatives included.

    Raises ValueError for a function that holds a compiled kernel or runs Python: no other computer could load the file.
    """
    path = Path(path)
    with replacing(path) as beside:
        try:
            function.save(str(beside), {"debug": True})
            content = beside.read_bytes()
        except RuntimeError as error:
            raise OSError(str(error).splitlines()[-1]) from None
        kinds = _values_of(_fields(content), _CLASS)
        if any(value.startswith(_text(kind)) for value in kinds for kind in _BOUND_HERE):
            raise ValueError(
                f"function {function.name()} holds a compiled kernel or runs Python, which no file carries, expected "
                "formulas only: take a surrogate's function(compiled=False), and export_c or export_fmu of a foundation"
            )
        beside.write_bytes(content + _seal(content))


def load_function(path: str | Path, *, allow_external: bool = False) -> ca.Function:
    """Read a ``.casadi`` file that `save_function` wrote.

    allow_external: read any file that CasADi can, also one that `save_function` did not write, or that runs a library:
    trust such a file as you would a program. Raises FileNotFoundError if there is none, and ValueError for a file that
    is damaged, not a CasADi function, or needs allow_external.
    """
    path = existing_file(path, "CasADi file")
    checked_size(path, MOST_DATA)
    content = path.read_bytes()
    if not allow_external:
        _check(path, content)
    try:
        function = ca.StringDeserializer(content.decode("latin-1")).unpack()
    except Exception:  # CasADi raises bare errors of several kinds for foreign or damaged bytes
        function = None
    if not isinstance(function, ca.Function):
        raise ValueError(
            f"{path} is not a CasADi function that CasADi {ca.CasadiMeta.version()} can read, "
            "expected a file written by save_function with this or an older version"
        )
    return function


def _seal(content: bytes) -> bytes:
    return _SEAL + hashlib.sha256(content).hexdigest().encode() + b"\n"


def _check(path: Path, whole: bytes) -> None:
    """Raise ValueError unless the bytes are as `save_function` wrote them and hold formulas only."""
    content, seal, _ = whole.partition(_SEAL)
    if not seal:
        raise ValueError(
            f"{path} was not written by save_function of this version, expected a file that ends in its digest: save "
            "the function again, or give allow_external=True if you trust the file as you would a program"
        )
    if whole != content + _seal(content):
        raise ValueError(f"{path} is damaged (its digest does not match), expected what save_function wrote")
    if content.translate(None, _DIGITS) or len(content) % 2:
        raise ValueError(f"{path} is not a CasADi function, expected a file written by save_function")
    fields = _fields(content)
    if fields[_HEAD : _HEAD + 1] != _NAMED_FIELDS:
        raise ValueError(f"{path} lacks the names of its fields, expected a file written by save_function")
    for value in _values_of(fields, _CLASS):
        if not any(value.startswith(_text(kind)) for kind in _PLAIN):
            raise ValueError(
                f"{path} holds a function that may run foreign code, expected formulas only: "
                "give allow_external=True if you trust the file as you would a program"
            )
    foreign = any(_text(name) in fields for name in _FOREIGN)
    if foreign or any(not value.startswith(b"b\0") for value in _values_of(fields, b"FunctionInternal::jit")):
        raise ValueError(f"{path} loads a plug-in or compiles C when it is read: allow_external=True if you trust it")


def _fields(content: bytes) -> bytes:
    """The bytes that CasADi wrote as pairs of letters."""
    digits = content.translate(_FROM_HEX)
    swapped = bytearray(len(digits))
    swapped[::2], swapped[1::2] = digits[1::2], digits[::2]
    return bytes.fromhex(swapped.decode())


def _text(text: bytes) -> bytes:
    """How CasADi writes a string: s, i, its length in four bytes, and itself."""
    return b"si" + len(text).to_bytes(4, "little") + text


def _values_of(fields: bytes, name: bytes) -> list[bytes]:
    """The first bytes of what stands under every field of this name."""
    return [value[:40] for value in fields.split(_text(name))[1:]]
