"""A small model with JAM's contact: a ball (thigh) on a plate (shank), ligaments, one of which wraps, and a muscle."""

from pathlib import Path

import numpy as np

from tests.support.meshes import cap_mesh, sheet_mesh, write_obj

RADIUS = 0.02  # m


def _frame(name):
    return f"<socket_parent_frame>/{name}</socket_parent_frame>"


def _path(points, wrap=""):
    listed = "".join(
        f'<PathPoint name="p{i}">{_frame(f"bodyset/{body}")}<location>{" ".join(map(str, at))}</location></PathPoint>'
        for i, (body, at) in enumerate(points)
    )
    over = f'<PathWrap name="w"><wrap_object>{wrap}</wrap_object><method>hybrid</method></PathWrap>' if wrap else ""
    return (
        f"<GeometryPath><PathPointSet><objects>{listed}</objects></PathPointSet>"
        f"<PathWrapSet><objects>{over}</objects></PathWrapSet></GeometryPath>"
    )


def _ligament(name, points, slack, wrap=""):
    return (
        f'<Blankevoort1991Ligament name="{name}">{_path(points, wrap)}<linear_stiffness>2000</linear_stiffness>'
        f"<slack_length>{slack}</slack_length></Blankevoort1991Ligament>"
    )


def _mesh(name, body, file):
    return (
        f'<Smith2018ContactMesh name="{name}"><socket_frame>/bodyset/{body}</socket_frame><mesh_file>{file}</mesh_file>'
        "<elastic_modulus>5e6</elastic_modulus><poissons_ratio>0.45</poissons_ratio><thickness>0.002</thickness>"
        "</Smith2018ContactMesh>"
    )


def _axis(name, axis, coordinate=""):
    of = f"<coordinates>{coordinate}</coordinates>" if coordinate else "<coordinates></coordinates>"
    function = "<LinearFunction><coefficients>1 0</coefficients></LinearFunction>"
    function = function if coordinate else "<Constant><value>0</value></Constant>"
    return f'<TransformAxis name="{name}">{of}<axis>{axis}</axis><function>{function}</function></TransformAxis>'


def _coordinate(name, default, low, high):
    return f'<Coordinate name="{name}"><default_value>{default}</default_value><range>{low} {high}</range></Coordinate>'


def _body(name, mass, wraps=""):
    return (
        f'<Body name="{name}"><WrapObjectSet><objects>{wraps}</objects></WrapObjectSet><mass>{mass}</mass>'
        "<mass_center>0.01 -0.1 0.02</mass_center><inertia>0.02 0.03 0.04 0.001 0.002 0.003</inertia></Body>"
    )


def _contact(name, target, casting):
    return (
        f'<Smith2018ArticularContactForce name="{name}"><socket_target_mesh>/contactgeometryset/{target}'
        f"</socket_target_mesh><socket_casting_mesh>/contactgeometryset/{casting}</socket_casting_mesh>"
        "<max_proximity>0.02</max_proximity></Smith2018ArticularContactForce>"
    )


def write_model_with_disc(folder: Path, thickness=0.003) -> Path:
    """The small model with a loose disc between ball and plate, pressed on both faces: a meniscus."""
    model, sheet = write_small_model(folder), sheet_mesh(0.016, 0.001)
    write_obj(folder / "top.obj", sheet[0] + [0.0, thickness, 0.0], sheet[1])
    write_obj(folder / "bottom.obj", sheet[0], sheet[1][:, ::-1])
    moves = [_axis(f"rotation{i + 1}", axis) for i, axis in enumerate(("1 0 0", "0 1 0", "0 0 1"))]
    moves += [_axis("translation1", "1 0 0"), _axis("translation2", "0 1 0", "float"), _axis("translation3", "0 0 1")]
    joint = f'<CustomJoint name="loose">{_frame("bodyset/shank")}<socket_child_frame>/bodyset/disc</socket_child_frame>'
    joint += f"<coordinates>{_coordinate('float', 0, -1, 1)}</coordinates>"
    joint += f"<SpatialTransform>{''.join(moves)}</SpatialTransform></CustomJoint>"
    forces = _contact("upper", "ball", "top") + _contact("lower", "bottom", "plate")
    parts = {"BodySet": _body("disc", 0.01), "JointSet": joint, "ForceSet": forces}
    parts["ContactGeometrySet"] = _mesh("top", "disc", "top.obj") + _mesh("bottom", "disc", "bottom.obj")
    text = model.read_text().replace("-0.0199", str(-RADIUS - thickness + 1e-4))
    for kind, more in parts.items():
        before, after = text.split(f"</{kind}>")
        text = f"{before.removesuffix('</objects>')}{more}</objects></{kind}>{after}"
    model.write_text(text)
    return model


def write_small_model(folder: Path, *, side="r", contact=True) -> Path:
    """Write the model and its meshes, in m and under other names than it knows, into `folder` and `folder/meshes`."""
    (folder / "meshes").mkdir(exist_ok=True)
    ball, plate = cap_mesh(RADIUS, 0.0012, 1.0), sheet_mesh(0.03, 0.001)
    write_obj(folder / "meshes" / "thigh_ball.obj", *ball)
    write_obj(folder / "meshes" / "shank_plate.obj", *plate)
    turns = _axis("rotation1", "0 0 1", f"flex_{side}") + _axis("rotation2", "1 0 0") + _axis("rotation3", "0 1 0")
    moves = _axis("translation1", "1 0 0") + _axis("translation2", "0 1 0", f"sink_{side}")
    moves += _axis("translation3", "0 0 1")
    cylinder = '<WrapCylinder name="roll"><translation>0.03 0 0</translation><radius>0.015</radius><length>0.2</length>'
    cylinder += "<quadrant>+x</quadrant></WrapCylinder>"
    lateral = [("thigh", (0.0, 0.02, 0.03)), ("shank", (0.0, -0.03, 0.03))]
    front = [("thigh", (0.025, 0.06, 0.0)), ("shank", (0.03, -0.03, 0.0))]
    muscle = _path([("thigh", (-0.02, 0.15, 0.0)), ("shank", (-0.02, -0.02, 0.0))])
    path = folder / "small.osim"
    path.write_text(f"""<?xml version="1.0" encoding="UTF-8" ?>
<OpenSimDocument Version="40000"><Model name="small"><gravity>0 -9.8 0</gravity>
<BodySet name="bodyset"><objects>{_body("thigh", 2.0, cylinder)}{_body("shank", 1.5)}</objects></BodySet>
<JointSet name="jointset"><objects>
<PinJoint name="hip_{side}">{_frame("ground")}<socket_child_frame>/bodyset/thigh</socket_child_frame>
<coordinates>{_coordinate(f"hip_{side}", 0.1, -1, 1)}</coordinates></PinJoint>
<CustomJoint name="knee_{side}">{_frame("bodyset/thigh")}<socket_child_frame>/bodyset/shank</socket_child_frame>
<coordinates>{_coordinate(f"flex_{side}", 0, -0.1, 0.6)}{_coordinate(f"sink_{side}", -0.0199, -1, 1)}</coordinates>
<SpatialTransform>{turns}{moves}</SpatialTransform></CustomJoint></objects></JointSet>
<ForceSet name="forceset"><objects>{_ligament("lateral", lateral, 0.068)}{_ligament("front", front, 0.105, "roll")}
<Millard2012EquilibriumMuscle name="back">{muscle}<max_isometric_force>800</max_isometric_force>
<optimal_fiber_length>0.09</optimal_fiber_length><tendon_slack_length>0.1</tendon_slack_length>
<pennation_angle_at_optimal>0.2</pennation_angle_at_optimal></Millard2012EquilibriumMuscle>
<HuntCrossleyForce name="floor"></HuntCrossleyForce>
{_contact("joint_contact", "ball", "plate") if contact else ""}</objects></ForceSet>
<ContactGeometrySet name="contactgeometryset"><objects>
{_mesh("ball", "thigh", "model-thigh-ball.stl") + _mesh("plate", "shank", "model-shank-plate.stl") if contact else ""}
</objects></ContactGeometrySet></Model></OpenSimDocument>
""")
    return path


def random_states(assembly, count, seed=0):
    """q (count, n) [m, rad] about rest."""
    rng = np.random.default_rng(seed)
    return assembly.default + rng.uniform(-1.0, 1.0, (count, len(assembly.coordinates))) * [
        0.004 if c.kind == "translation" else 0.4 for c in assembly.coordinate_table.values()
    ]
