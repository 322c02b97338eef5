"""The natural knee's scene, written by ``casadi-contact scene``: walking settles on its cartilage."""

from pathlib import Path

import casadi_contact as cc
from casadi_contact.samples.reference import reference_poses
from casadi_contact.scenes.walking import reference_cycles
from tests.support import meshes  # noqa: F401  (skips without the extra `mesh`)
from tests.support.shared_data import shared_file

SCENE = Path(__file__).parents[3] / "problems" / "scenes" / "tka_mesh.toml"


def test_walking_settles_on_the_natural_knee(tmp_path):
    folder = shared_file("data/jam/femur_cartilage.obj").parent
    text = SCENE.with_name("natural_knee.toml").read_text("utf-8").replace("../../../shared/data/jam", str(folder))
    (tmp_path / "knee.toml").write_text(text.replace('elements = "grid"', 'elements = "grid"\nspacing = 1.0'))
    model = cc.ElasticFoundation(cc.load_scene(tmp_path / "knee.toml"))
    _, report = reference_poses(model, reference_cycles()[:2], frames=51)
    assert report.converged.all()
