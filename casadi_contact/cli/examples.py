"""Examples at the end of each command's help text."""

_EXAMPLES = {
    "": (
        "info knee",
        "show knee",
        "export knee --kernel",
        "build knee --preset standard",
    ),
    "scene": (
        "scene femur.stl insert.stl --side right --out my_knee.toml",
        "scene head.stl cup.stl --joint hip --axes=-x,z,y --material cartilage",
    ),
    "cut": ("cut my_knee.toml --to my_knee_parts.toml",),
    "build": (
        "build knee",
        "build knee --preset standard --cycles walk1.csv walk2.csv",
        "build my_joint.toml --table samples.csv --out results/my_joint",
    ),
    "sample": (
        "sample knee --cycles walk1.csv walk2.csv",
        "sample knee --preset paper --model foundation",
        "sample my_joint.toml --table samples.csv",
    ),
    "train": ("train knee --preset standard",),
    "calibrate": ("calibrate knee --preset standard",),
    "evaluate": ("evaluate knee --preset standard",),
    "export": (
        "export knee",
        "export knee --kernel --out results/my_knee",
        "export knee --foundation",
        "export knee --fmu",
    ),
    "chart": (
        "chart knee --preset standard",
        "chart knee --peers",
    ),
    "speed": (
        "speed knee",
        "speed knee --preset standard",
    ),
    "choose": (
        "choose knee --force-tol 2 --torque-tol 50",
        "choose knee --force-tol 2 --loads Fy_med,Fy_lat --preset standard",
    ),
    "info": (
        "info knee",
        "info results/knee-quick/patch.h5",
    ),
    "report": (
        "report knee --out knee.html",
        "report results/knee-quick/patch.h5",
    ),
    "cycle": (
        "cycle walk.mot --map knee_angle_r=-rz:deg --map knee_rot_r=ry:deg --map F_med=Fy_med:N --map F_lat=Fy_lat:N "
        "--map cop_x=cop_ap:m --map cop_z=cop_ml:m",
        "cycle fluoroscopy.sto --map t_x=tx:m --map t_y=ty:m --map t_z=tz:m --map r_x=rx --map r_y=ry --map r_z=rz",
    ),
    "show": (
        "show knee",
        "show knee --pose=0.5,27.35,0.1,0,-0.05,-0.3 --out knee.png",
        "show my_knee.toml --poses poses.csv",
    ),
    "page": (
        "page knee --out knee.html",
        "page my_knee.toml --poses poses.csv --surrogate results/my_knee-quick/patch.h5",
    ),
}


def examples(command: str) -> str:
    """The examples of a command ("": of the whole), a paragraph each."""
    return "\n\n".join(("Examples:", *(f"casadi-contact {line}" for line in _EXAMPLES[command])))
