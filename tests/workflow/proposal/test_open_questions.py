"""What a proposal leaves open about mesh files."""

import trimesh

from casadi_contact.geometry.mesh import load_mesh
from casadi_contact.workflow.proposal.open_questions import coarse_coordinates


def test_coordinates_that_single_precision_rounds_coarsely_are_an_open_question(tmp_path):
    """Binary STL holds single precision: 1e5 mm to steps of 1/128 mm; an OBJ file holds all its digits."""
    ball = trimesh.creation.icosphere(subdivisions=3, radius=20.0)
    said = {}
    for far in (0.0, 1e5):
        moved = ball.copy().apply_translation([far, 0.0, 0.0])
        for kind in ("stl", "obj"):
            moved.export(tmp_path / f"ball.{kind}")
            said[far, kind] = coarse_coordinates({"moving": load_mesh(tmp_path / f"ball.{kind}", "mm")}, "mm")
    assert [line.split(":")[0] for line in said.pop((1e5, "stl"))] == ["where the surfaces are to less than 0.0078 mm"]
    assert not any(said.values())
