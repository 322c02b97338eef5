"""The command line: ``casadi-contact scene | build | sample | train | ...``."""

import sys
from collections.abc import Iterable
from typing import Annotated

import typer

from casadi_contact import __version__
from casadi_contact.cli.build import build, calibrate, evaluate, export, sample, train
from casadi_contact.cli.commands import chart, choose, cycle, import_, info, page, report, scene, show, speed
from casadi_contact.cli.options import say
from casadi_contact.core.terminal import new_app, run_app

EXAMPLES = """\
scene femur.stl insert.stl --side right --out my_knee.toml
scene head.stl cup.stl --joint hip --axes=-x,z,y --material cartilage
import lenhart2015.osim --joint knee_r --geometry Geometry --out my_knee
build knee
build knee --preset standard --cycles walk1.csv walk2.csv
build my_knee --cycles results/comak/values.sto
build my_joint.toml --table samples.csv --out results/my_joint
sample knee --preset full --model foundation
train knee --preset standard
calibrate knee --preset standard
evaluate knee --preset standard
export knee --foundation
export knee --fmu
chart knee --preset standard
speed knee
choose knee --force-tol 2 --torque-tol 50
choose knee --force-tol 2 --loads Fy_med,Fy_lat
info knee
report knee --out knee.html
cycle walk.mot --map knee_angle_r=-rz:deg --map knee_rot_r=-ry:deg --map F_med=Fy_med:N --map F_lat=Fy_lat:N \
--map cop_x=cop_ap:m --map cop_z=cop_ml:m
cycle fluoroscopy.sto --map t_x=tx:m --map t_y=ty:m --map t_z=tz:m --map r_x=rx --map r_y=ry --map r_z=rz
cycle states.sto --tibia-in-femur right --map knee_tx_r=tx --map knee_ty_r=ty --map knee_tz_r=tz --map knee_add_r=rx \
--map knee_rot_r=ry --map knee_flex_r=rz --out poses.csv
show knee --pose=0.5,27.35,0.1,0,-0.05,-0.3 --out knee.png
show my_knee.toml --poses poses.csv
page knee --out knee.html
page my_knee.toml --poses poses.csv --surrogate results/my_knee-quick/patch.h5
""".splitlines()
_FIRST = ("info knee", "show knee", "export knee --fmu", "build knee --preset standard")


def examples(lines: Iterable[str]) -> str:
    """Examples of commands, a paragraph each."""
    return "\n\n".join(("Examples:", *(f"casadi-contact {line}" for line in lines)))


app = new_app(help="Surrogate models of deformable joint contact as CasADi functions.", epilog=examples(_FIRST))


def _print_version(requested: bool) -> None:
    if requested:
        say(f"casadi_contact {__version__}")
        raise typer.Exit


@app.callback()
def options(
    version: Annotated[
        bool, typer.Option("--version", callback=_print_version, is_eager=True, help="print the version and end")
    ] = False,
) -> None:
    """Options that come before a command."""


_PROJECT = (build, sample, train, calibrate, evaluate, export, chart, speed, choose)
for command in (scene, import_, *_PROJECT, info, report, cycle, show, page):
    whole_sentence = " ".join((command.__doc__ or "").split("\n\n")[0].split())  # else cut off in the list of commands
    mine = examples(line for line in EXAMPLES if line.split()[0] == command.__name__)
    app.command(epilog=mine, short_help=whole_sentence)(command)


def main() -> None:
    """Entry point: a user's mistake is one line on stderr, never a traceback."""
    run_app(app, "casadi-contact", sys.argv[1:] or ["--help"])


if __name__ == "__main__":
    main()
