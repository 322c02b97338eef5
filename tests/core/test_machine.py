"""A result says what it was measured on, down to the instruction set."""

import json

import numpy as np
import pytest

from casadi_contact.core import machine
from casadi_contact.core.machine import blas_environment, machine_record
from problems.summary import write_summary


def test_a_record_names_the_flags_that_kernels_are_compiled_with(monkeypatch):
    monkeypatch.setenv("CASADI_CONTACT_CFLAGS", "-march=x86-64-v2")
    assert machine_record()["kernel_flags"] == "-march=x86-64-v2"
    monkeypatch.delenv("CASADI_CONTACT_CFLAGS")
    record = machine_record()
    assert record["kernel_flags"] == "-march=native"
    assert all(isinstance(value, str) and value for value in record.values())


AVX512 = "fpu avx2 avx512f avx512bw avx512cd avx512dq avx512vl"


@pytest.mark.parametrize(
    ("vendor", "flags", "chosen"),
    [
        ("AuthenticAMD", AVX512, {"OPENBLAS_CORETYPE": "SkylakeX"}),
        ("AuthenticAMD", "avx2", {}),
        ("GenuineIntel", AVX512, {}),
    ],
)
def test_blas_is_told_of_avx512_where_it_overlooks_it(vendor, flags, chosen, monkeypatch):
    monkeypatch.delenv("OPENBLAS_CORETYPE", raising=False)
    monkeypatch.setattr(machine, "cpuinfo", lambda key: vendor if key == "vendor_id" else flags)
    assert blas_environment() == chosen
    monkeypatch.setenv("OPENBLAS_CORETYPE", "Haswell")
    assert blas_environment() == {}, "as the user chose it"


def test_a_summary_has_null_for_what_is_no_number(tmp_path):
    content = {"a": np.float64("nan"), "b": [1.5, float("inf")], "c": {"d": (float("nan"), "NaN", 2)}}
    write_summary(tmp_path / "summary.json", content)
    found = json.loads((tmp_path / "summary.json").read_text("utf-8"), parse_constant=pytest.fail)
    assert found.pop("machine")
    assert found == {"a": None, "b": [1.5, None], "c": {"d": [None, "NaN", 2]}}
