"""Small files of others that were once misread (shared data): each is read as its format says, or doubted aloud."""

import numpy as np
import pytest

from casadi_contact.geometry.mesh import load_mesh
from casadi_contact.scenes.cycle import read_cycle
from casadi_contact.scenes.loading import load_scene
from casadi_contact.scenes.pose_file import read_poses
from casadi_contact.scenes.shapes.mesh_bodies import patch_mesh
from casadi_contact.workflow.proposal.frame import frame_of
from casadi_contact.workflow.proposal.joint_geometry import joint_geometry
from casadi_contact.workflow.proposal.propose import load_meshes
from tests.support.shared_data import shared_file


def ball(name, faces=5120, across_mm=60.0):
    def same(folder):
        mesh = load_mesh(folder / name, "mm")
        return (len(mesh.faces), round(np.ptp(mesh.vertices_mm, axis=0).max(), 3)) == (faces, across_mm)

    return same


def table(name, degrees):
    return lambda folder: np.allclose(read_poses(folder / name)[0], [0.5, 27.2, 0.1, *np.radians(degrees)])


def proposed(moving, fixed, axes=None):
    """The open questions and the direction of pressing."""
    geometry = joint_geometry(load_meshes({"moving": moving, "fixed": fixed}, None)[1], axes=axes)
    return " ".join(frame_of(geometry, axes=axes).open_questions), geometry.placement.pressing.tolist()


def patella(folder):
    files = folder / "sb_Patella.obj", folder / "sb_Femur.obj"
    return "--axes" in proposed(*files)[0] and proposed(*files, ("-x", "y", "-z"))[1] == [-1.0, 0.0, 0.0]


def swapped(_):
    files = [shared_file(f"data/dm_tka/{name}.stl") for name in ("tibial_insert", "femoral_component")]
    return ["exchanged" in proposed(*each)[0] for each in (files, files[::-1])] == [True, False]


def divided(scene, patch, **files):
    """Whether the triangles that bear a patch are small, of another fixed mesh too."""

    def small(folder):
        geometry = {**load_scene(folder / scene).geometry, **{body: str(folder / name) for body, name in files.items()}}
        del geometry["fixed_sha256"]
        return len(patch_mesh(geometry, patch).faces) > 1000

    return small


CASES = {
    "csv_comment_line": lambda folder: read_cycle(folder / "cycle.csv").loads["Fy_med"][0] == -600.0,
    "mot_angles_are_in_degrees": table("poses.mot", [1.0, 2.0, -3.0]),
    "mot_unused_column_twice": table("poses.mot", [10.0, 20.0, -30.0]),
    **dict.fromkeys(("obj_indented_faces", "obj_tab_after_v", "obj_upper_case_keys"), ball("ball.obj")),
    "patella_in_its_own_frame": patella,
    "ply_texture_comment": ball("ball.ply", 1280, 50.0),
    "sole_on_coarse_ground": divided("foot_sole.toml", "heel", fixed="ground12.stl"),
    **dict.fromkeys(("stl_one_byte_more", "stl_zero_facet_ct_frame"), ball("ball.stl")),
    **dict.fromkeys(("stl_point_facet_warning", "stl_sliver_inf_needle"), ball("ball.stl", 1280, 50.0)),
    "sto_in_degrees_y": table("poses.sto", [1.0, 2.0, -3.0]),
    **dict.fromkeys(("sto_ncolumns_off", "sto_quoted_header"), table("poses.sto", [10.0, 20.0, -30.0])),
    "swapped_bodies": swapped,
    "triangles_as_elements_coarse": divided("ball.toml", "contact"),
}
REFUSED = {
    "cycle_cop_in_cm": (lambda folder: read_cycle(folder / "cycle.csv"), "unit cm?"),
    "inch_files": (lambda folder: load_meshes({"moving": folder / "plate_inch.stl"}, None), "inch"),
    "obj_concave_ngon": (lambda folder: load_mesh(folder / "plate.obj", "mm"), "not convex"),
    "ply_tristrips": (lambda folder: load_mesh(folder / "ball.ply", "mm"), "strips"),
}


@pytest.mark.filterwarnings("error", "ignore:.*truncated:UserWarning")
@pytest.mark.parametrize("name", [*CASES, *REFUSED])
def test_a_file_of_others_is_read_right_or_refused_with_its_cure(name):
    folder = shared_file(f"data/cases/{name}/README.md").parent
    if name in CASES:
        assert CASES[name](folder)
    else:
        with pytest.raises(ValueError, match=REFUSED[name][1]):
            REFUSED[name][0](folder)
