"""Write a contact model as an FMU: description, C sources, and a library compiled for this platform."""

from __future__ import annotations

import hashlib
import platform
import sys
import tempfile
import zipfile
from collections.abc import Sequence
from pathlib import Path
from string import Template

from casadi_contact.files import replacing
from casadi_contact.transcription.export_c import ExportedModel
from casadi_contact.transcription.fmu.description import model_description
from casadi_contact.transcription.kernel.compiler import DATA_FILE, SUFFIX, portable_library
from casadi_contact.transcription.kernel.source import c_text

_C = f"{__package__}.c"
_SYSTEMS = {"linux": "linux", "darwin": "darwin"}
_PROCESSORS = {"x86_64": "x86_64", "AMD64": "x86_64", "aarch64": "aarch64", "arm64": "aarch64"}
_BUILD = """\
<?xml version="1.0" encoding="UTF-8"?>
<fmiBuildDescription fmiVersion="3.0">
  <BuildConfiguration modelIdentifier="{name}">
    <SourceFileSet language="C99">
      <SourceFile name="fmi3.c"/>
      <SourceFile name="{name}.c"/>
    </SourceFileSet>
  </BuildConfiguration>
</fmiBuildDescription>
"""
_DATE = (2000, 1, 1, 0, 0, 0)  # of every entry, so that the same model gives the same bytes


def export_fmu(model: ExportedModel, path: str | Path, *, name: str, start: Sequence[float]) -> Path:
    """Write an FMU (FMI 3.0, model exchange and co-simulation, directional and adjoint derivatives); return its path.

    Inputs are the pose [mm, rad], from `start` (6) on; outputs the loads [N, N·mm] and root loads; validity and
    expected errors can be read. Compiled for any processor of this machine's kind, or as $CASADI_CONTACT_CFLAGS says.
    Raises CompilerError (an OSError) without a compiler and on a system other than Linux and macOS, ValueError for an
    unusable name.
    """
    if name == "fmi3":
        raise ValueError(f"function name {name!r} is not usable, fmi3.c is FMI's own interface: choose another")
    path, words = Path(path), model.words(name)
    words["start"] = ", ".join(repr(float(value)) for value in start)
    sources = {f"{name}.h": model.header(name), f"{name}.c": model.c_source(name)}
    words["token"] = token = hashlib.sha256(f"{sources[f'{name}.c']}{words['start']}".encode()).hexdigest()
    sources["fmi3.c"] = Template(c_text("fmi3.c", _C)).substitute(words)
    sources["fmi3_unsupported.h"] = c_text("fmi3_unsupported.h", _C)
    path.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=path.parent, prefix=f".{path.name}.") as folder:
        place = Path(folder)
        try:
            for file, text in sources.items():
                (place / file).write_text(text, "utf-8")
            if model.data:
                (place / DATA_FILE).write_bytes(model.data)
        except OSError as error:
            raise OSError(f"cannot write {path}: {error.strerror or error}") from None
        library = portable_library(place, ["fmi3.c", f"{name}.c"], f"{name}{SUFFIX}").read_bytes()
    entries: dict[str, str | bytes] = {"modelDescription.xml": model_description(model, name, token, start)}
    entries |= {f"sources/{file}": text for file, text in sources.items()}
    if model.data:
        entries[f"sources/{DATA_FILE}"] = model.data
    entries["sources/buildDescription.xml"] = _BUILD.format(name=name)
    entries[f"binaries/{_platform()}/{name}{SUFFIX}"] = library
    with replacing(path) as beside, zipfile.ZipFile(beside, "w", zipfile.ZIP_DEFLATED) as archive:
        for entry, content in entries.items():
            archive.writestr(zipfile.ZipInfo(entry, _DATE), content, zipfile.ZIP_DEFLATED)
    return path


def _platform() -> str:
    """As FMI names it: x86_64-linux."""
    processor, system = _PROCESSORS.get(platform.machine()), _SYSTEMS.get(sys.platform)
    if processor is None or system is None:
        raise OSError(
            f"no FMU for {platform.machine()} on {sys.platform}, expected x86_64 or aarch64 on linux or darwin"
        )
    return f"{processor}-{system}"
