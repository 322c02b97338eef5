"""The machine: a record of what a measurement was made on, and environment variables for fast matrix products."""

import os
import platform
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

PACKAGES = ("casadi_contact", "casadi", "numpy", "scipy", "numba", "h5py", "torch")

# The widest vector instructions that the kernels can profit from, widest first, by the flag that Linux shows for them.
_INSTRUCTION_SETS = {"avx512f": "AVX-512", "avx2": "AVX2", "avx": "AVX", "sse4_2": "SSE4.2", "asimd": "NEON"}
CFLAGS_VARIABLE = "CASADI_CONTACT_CFLAGS"  # chooses the kernels' instruction set in place of this processor's own
_BLAS_VARIABLE = "OPENBLAS_CORETYPE"  # chooses the processor that OpenBLAS multiplies matrices for
_BLAS_NEEDS = {"avx512f", "avx512bw", "avx512cd", "avx512dq", "avx512vl"}  # of its kernels for "SkylakeX"


def cpuinfo(*keys: str) -> str:
    """The value of the first line of /proc/cpuinfo with one of the keys; empty where there is none."""
    path = Path("/proc/cpuinfo")
    for line in path.read_text(errors="replace").splitlines() if path.is_file() else ():
        key, _, value = line.partition(":")
        if key.strip() in keys:
            return value.strip()
    return ""


def instruction_set() -> str:
    """The widest vector instructions of this processor ("AVX2"); "unknown" without."""
    known = set(cpuinfo("flags", "Features").split())
    return next((name for flag, name in _INSTRUCTION_SETS.items() if flag in known), "unknown")


def blas_environment() -> dict[str, str]:
    """Environment variables with which a new process multiplies matrices by AVX-512 on an AMD processor that has it,
    for which OpenBLAS takes kernels of a Haswell, twice as slow; none on others, and where the user has chosen."""
    able = cpuinfo("vendor_id") == "AuthenticAMD" and set(cpuinfo("flags").split()) >= _BLAS_NEEDS
    wanted = able and _BLAS_VARIABLE not in os.environ
    return {_BLAS_VARIABLE: "SkylakeX"} if wanted else {}


def _version(package: str) -> str:
    try:
        return version(package)
    except PackageNotFoundError:
        return "not installed"


def machine_record() -> dict[str, str]:
    """Processor, its instruction set, what kernels are compiled for, cores, system and versions, as plain text."""
    return {
        "processor": cpuinfo("model name") or platform.processor() or platform.machine(),
        "instruction_set": instruction_set(),
        "kernel_flags": os.environ.get(CFLAGS_VARIABLE, "-march=native"),
        "cores": str(os.cpu_count()),
        "system": f"{platform.system()} {platform.machine()}",
        "python": platform.python_version(),
        **{package: _version(package) for package in PACKAGES},
    }
