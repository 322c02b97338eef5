"""What is measured, and that the table shows it; never how fast."""

import json

import pytest

from casadi_contact.benchmark.kernel_speed import kernel_speed
from casadi_contact.report import kernel_speed_tables, read_kernel_speed
from casadi_contact.scenes import load_scene
from tests.support.compiler import needs_compiler
from tests.support.random_surrogates import random_poses, random_surrogate


@needs_compiler
@pytest.mark.parametrize("structure", ["patch", "two_stage"])
def test_every_form_is_timed_and_the_limit_counts_all_networks(structure):
    surrogate = random_surrogate(load_scene("sphere_on_plane"), structure)
    found = kernel_speed(surrogate, random_poses(5), repeats=1)
    assert all(timing.median_us > 0.0 for timing in found.timings.values())
    assert {"value, kernel", "Jacobian, graph", "Hessian, kernel", "EF 80×40"} <= set(found.timings)
    (first, *others) = surrogate.networks.values()
    per_network = [net.parameter_count - sum(net.hidden) - 1 for net in (first, *others)]
    assert found.limit.multiply_adds == sum(per_network)
    assert found.limit.sigmoids == sum(sum(net.hidden) for net in surrogate.networks.values())
    assert found.limit.us > 0.0


def test_the_table_is_drawn_from_the_file_alone(tmp_path):
    timing = {"median_us": 2.0, "low_us": 1.0, "high_us": 3.0}
    times = {"value, graph": {**timing, "median_us": 9.0}, "value, kernel": timing, "EF 40×30": timing}
    found = {"microseconds": times, "limit_us": 0.5, "limit": "why"}
    path = tmp_path / "kernel_speed.json"
    path.write_text(json.dumps({"format": "casadi_contact kernel speed", "surrogates": {"patch": found}}))
    (table,) = kernel_speed_tables(read_kernel_speed(path))
    cells = [list(column.cells) for column in table.columns]
    assert cells[0] == [*times, "machine's limit"]
    assert cells[3][:3] == ["4.50", "1.00", "1.00"]
    assert "4.0 times the limit" in cells[3][3]
    path.write_text("{}")
    with pytest.raises(ValueError, match="not a file of kernel speed"):
        read_kernel_speed(path)
