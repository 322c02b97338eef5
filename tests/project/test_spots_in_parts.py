"""Parts of several spots cannot be fitted together, which is said before hours of samples."""

import pytest

from casadi_contact.project import Project
from tests.support.meshes import cap_mesh, mesh_scene_text, sheet_mesh, write_obj


@pytest.mark.parametrize("asked", ["spots = 4", "z = [0, 2]\nsplit_z = [1]", "spots = 4\nz = [0, 2]\nsplit_z = [1]"])
@pytest.mark.parametrize("preset", ["parts", "quick"])
def test_parts_of_several_spots_are_refused_by_the_preset_that_fits_parts_together_alone(tmp_path, asked, preset):
    write_obj(tmp_path / "ball.obj", *cap_mesh(20.0, 3.0, 0.5))
    write_obj(tmp_path / "plate.obj", *sheet_mesh(10.0, 2.0))
    patch = "[geometry.patches.contact]"
    text = mesh_scene_text("ball.obj", "plate.obj").replace(patch, f"{patch}\n{asked}")
    (tmp_path / "scene.toml").write_text(text)
    scene, folder = tmp_path / "scene.toml", tmp_path / "out"
    if preset == "parts" and "spots" in asked and "split_z" in asked:
        with pytest.raises(ValueError, match=r"contact has split_z and 4 spots, and preset parts .*: leave out spots"):
            Project.open(scene, preset, folder)
        assert not folder.exists()
    else:
        assert len(Project.open(scene, preset, folder).scene.parts) == 1 + ("split_z" in asked)
