"""Draw the figures of method.md, opensim.md and finite-elements.md: ``python docs/figures.py``, into docs/pictures."""

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.patches import Ellipse, FancyBboxPatch, Polygon, Rectangle

import casadi_contact as cc
from casadi_contact.samples.reference import reference_poses
from casadi_contact.scenes.walking import reference_motion_cycles

PICTURES = Path(__file__).parent / "pictures"
BLUE, RED, GREEN, GREY = "#2b6cb0", "#c53030", "#2f855a", "#718096"


def main() -> None:
    """Write all figures; the same figure gives the same file."""
    plt.rcParams.update({"font.size": 10, "svg.hashsalt": "casadi_contact", "svg.fonttype": "path"})
    for name, draw in (("axes", axes), ("networks", networks), ("domains", domains)):
        figure = draw()
        figure.savefig(PICTURES / f"{name}.svg", metadata={"Date": None}, bbox_inches="tight")
        plt.close(figure)
    finite_elements().savefig(PICTURES / "finite_elements.png", dpi=110, bbox_inches="tight")


def axes() -> plt.Figure:
    """A right knee from its medial side and from above: frames and signs of this library, and of OpenSim."""
    figure, ((here, there), (here_above, there_above)) = plt.subplots(2, 2, figsize=(10.0, 8.6))
    for axis, title in (
        (here, "here: the femur moves in the insert"),
        (there, "OpenSim: the tibia moves in the femur"),
    ):
        axis.set(xlim=(-4.0, 4.0), ylim=(-3.4, 3.7), aspect="equal", title=title)
        axis.axis("off")
        _knee(axis)
    turn = np.radians(-20.0)  # flexion is rz < 0: the femur's shaft turns backwards
    x, y = np.array([np.cos(turn), np.sin(turn)]), np.array([-np.sin(turn), np.cos(turn)])
    _frame(here, (0.0, 1.35), x, y, RED, "moving")
    _frame(here, (0.0, -0.3), (1.0, 0.0), (0.0, 1.0), BLUE, "fixed")
    _turning(here, (0.6, 3.2), (1.75, 2.6), -0.25)
    here.text(1.75, 2.75, "flexion: rz < 0", color=RED)
    here.text(-3.9, -3.0, "x posterior, y superior, z medial (to the viewer)", color=BLUE)
    here.text(-3.9, -3.4, "mm, N, N·mm; loads act on the insert", color=GREY)
    _frame(there, (0.0, 1.35), (-1.0, 0.0), (0.0, 1.0), BLUE, "fixed", away=True)
    _frame(there, (0.0, -0.85), (-1.0, 0.0), (0.0, 1.0), RED, "moving", away=True)
    _turning(there, (0.9, -2.5), (2.3, -1.9), 0.25)
    there.text(1.5, -2.75, "flexion: knee_flex > 0", color=RED)
    there.text(-3.9, -3.0, "x anterior, y superior,\nz lateral (away)", color=BLUE)
    there.text(-3.9, -3.4, "m, N, N·m", color=GREY)
    for axis, title in ((here_above, "here, from above"), (there_above, "OpenSim, from above")):
        axis.set(xlim=(-4.0, 4.0), ylim=(-3.2, 2.9), aspect="equal", title=title)
        axis.axis("off")
        _plateau(axis)
    turn = np.radians(20.0)  # anterior turns to medial: counterclockwise on a right knee
    x, z = np.array([np.sin(turn), -np.cos(turn)]), np.array([-np.cos(turn), -np.sin(turn)])
    _frame(here_above, (0.0, 0.0), (0.0, -1.0), (-1.0, 0.0), BLUE, "", names="xz")
    _frame(here_above, (0.0, 0.0), 1.5 * x, 1.5 * z, RED, "", names="xz")
    _turning(here_above, (0.8, 2.3), (-0.8, 2.3), 0.25)
    here_above.text(1.0, 2.3, "femur inwards: ry > 0", color=RED)
    here_above.text(-3.9, -3.1, "adduction: rx > 0 (the medial side opens for rx < 0)", color=RED)
    _frame(there_above, (0.0, 0.0), (0.0, 1.0), (1.0, 0.0), BLUE, "", names="xz", away=True, dot=True)
    _frame(there_above, (0.0, 0.0), -1.5 * x, -1.5 * z, RED, "", names="xz", away=True, dot=True)
    _turning(there_above, (0.8, 2.3), (-0.8, 2.3), 0.25)
    there_above.text(1.0, 2.3, "tibia inwards: knee_rot > 0", color=RED)
    there_above.text(-3.9, -3.1, "adduction: knee_add > 0", color=RED)
    figure.tight_layout()
    return figure


def _turning(axis, start, end, bend) -> None:
    """An arrow along an arc: how the moving body turns."""
    style = {"arrowstyle": "-|>", "color": RED, "connectionstyle": f"arc3,rad={bend}"}
    axis.annotate("", end, start, arrowprops=style)


def _plateau(axis: plt.Axes) -> None:
    """The two dishes of a right insert from above; anterior is above, lateral on the right."""
    for x in (-1.5, 1.5):
        axis.add_patch(Ellipse((x, 0.0), 2.6, 3.4, facecolor="#fefcbf", edgecolor=GREY, lw=1.2))
    for x, y, text in (
        (-3.3, 0.0, "medial"),
        (3.3, 0.0, "lateral"),
        (0.0, 2.65, "anterior"),
        (0.0, -2.65, "posterior"),
    ):
        axis.text(x, y, text, color=GREY, rotation=90 if x else 0, ha="center", va="center")


def _knee(axis: plt.Axes) -> None:
    """Outline of a condyle in a dish; anterior is on the left."""
    angle = np.linspace(np.radians(160.0), np.radians(385.0), 80)
    condyle = np.column_stack([1.5 * np.cos(angle), 1.35 + 1.35 * np.sin(angle)])
    shaft = [(1.0, 3.4), (-1.0, 3.4)]
    axis.add_patch(Polygon([*condyle, *shaft], facecolor="#edf2f7", edgecolor=GREY, lw=1.2))
    x = np.linspace(-2.4, 2.4, 60)
    dish = np.column_stack([x, 0.12 * x**2 - 0.05])
    axis.add_patch(Polygon([*dish, (2.4, -1.2), (-2.4, -1.2)], facecolor="#fefcbf", edgecolor=GREY, lw=1.2))
    axis.add_patch(Rectangle((-1.2, -2.2), 2.4, 1.0, facecolor="#edf2f7", edgecolor=GREY, lw=1.2))
    axis.text(-3.0, 0.0, "anterior", color=GREY, rotation=90, va="center")
    axis.text(3.0, 0.0, "posterior", color=GREY, rotation=90, va="center")


def _frame(axis, origin, x, y, colour, name, away: bool = False, names: str = "xy", dot: bool = False) -> None:
    """Arrows of two axes; the third to the viewer (a dot) or away (a cross)."""
    for text, along in zip(names, (x, y), strict=True):
        tip = np.asarray(origin) + 1.1 * np.asarray(along)
        axis.annotate("", tip, origin, arrowprops={"arrowstyle": "-|>", "color": colour, "lw": 2.0})
        axis.text(*(tip + 0.2 * np.asarray(along)), text, color=colour, ha="center", va="center")
    cross = away and not dot
    axis.plot(*origin, "o", mfc="white", mec=colour, ms=12, mew=1.5)
    axis.plot(*origin, "x" if cross else "o", color=colour, ms=7 if cross else 4, mew=1.5)
    side = 1.0 if away else -1.0
    axis.text(
        origin[0] + 0.25 * side, origin[1] - 0.05, name, color=colour, ha="left" if away else "right", va="center"
    )


def networks() -> plt.Figure:
    """From the pose of the moving body to loads, in structure `patch`."""
    figure, axis = plt.subplots(figsize=(11.0, 3.6))
    axis.set(xlim=(0.0, 19.0), ylim=(0.0, 7.0))
    axis.axis("off")
    _box(axis, 0.2, 2.6, 2.6, 1.8, "pose\n(tx ty tz\nrx ry rz)", "#edf2f7")
    for y, name in ((4.2, "med"), (0.6, "lat")):
        _box(axis, 4.0, y, 3.2, 1.8, f"local pose of {name}\n(t + R·a, rx, ry, rz)", "#ebf8ff")
        _box(axis, 8.5, y + 0.98, 3.2, 0.95, "network: root load s", "#c6f6d5")
        _box(axis, 8.5, y - 0.13, 3.2, 0.95, "network: ratios ρ", "#c6f6d5")
        _box(axis, 12.9, y, 2.9, 1.8, "N = N0·max(s, 0)²\nW = N·ρ", "#fefcbf")
        _arrow(axis, (2.8, 3.5), (4.0, y + 0.9))
        for end in (y + 1.45, y + 0.35):
            _arrow(axis, (7.2, y + 0.9), (8.5, end))
            _arrow(axis, (11.7, end), (12.9, y + 0.9))
        _arrow(axis, (15.8, y + 0.9), (16.7, 3.5))
    _box(axis, 16.7, 2.6, 2.2, 1.8, "loads\nFy_med Fy_lat\nFx Fz Tx Ty Tz", "#edf2f7")
    return figure


def _box(axis, x, y, width, height, text, colour) -> None:
    axis.add_patch(FancyBboxPatch((x, y), width, height, boxstyle="round,pad=0.05", facecolor=colour, edgecolor=GREY))
    axis.text(x + width / 2, y + height / 2, text, ha="center", va="center", fontsize=9)


def _arrow(axis, start, end) -> None:
    axis.annotate("", end, start, arrowprops={"arrowstyle": "-|>", "color": GREY})


def domains() -> plt.Figure:
    """Where samples lie: around the motion in flexion and load, and in the loads of both sides."""
    figure, (left, right) = plt.subplots(1, 2, figsize=(9.5, 3.8))
    phase = np.linspace(0.0, 1.0, 200)
    flexion = 20.0 + 25.0 * np.sin(2.0 * np.pi * phase - 0.6) + 15.0 * np.sin(4.0 * np.pi * phase)
    load = 900.0 + 600.0 * np.sin(2.0 * np.pi * phase + 1.5) + 250.0 * np.cos(4.0 * np.pi * phase)
    left.add_patch(Rectangle((-32.0, 5.0), 110.0, 2200.0, facecolor="#f0fff4", edgecolor=GREEN, lw=1.2))
    left.text(-29.0, 2060.0, "D3: one large box", color=GREEN)
    left.plot(flexion, load, color="#bee3f8", lw=34, solid_capstyle="round")
    left.plot(flexion, load, color="#63b3ed", lw=13, solid_capstyle="round")
    left.plot(flexion, load, color="black", lw=1.5)
    left.text(56.0, 1500.0, "D2: wide\nenvelope", color=BLUE)
    left.text(7.0, 780.0, "D1: narrow\nenvelope of\nthe motion", color=BLUE)
    left.set(xlim=(-38.0, 86.0), ylim=(-60.0, 2400.0), xlabel="flexion [°]", ylabel="normal load of a side [N]")
    right.add_patch(Rectangle((5.0, 5.0), 95.0, 95.0, facecolor="#f0fff4", edgecolor="none"))
    right.text(50.0, 55.0, "D1, D2, D3\nboth sides loaded", ha="center", color=GREEN)
    right.plot([5.0, 100.0], [5.0, 5.0], color=RED, lw=4)
    right.plot([5.0, 5.0], [5.0, 100.0], color=RED, lw=4)
    right.text(55.0, 10.0, "D6: one side at the boundary", color=RED, ha="center")
    right.plot(5.0, 5.0, "s", color="black", ms=9)
    right.annotate("D7: both at\nthe boundary", (5.0, 5.0), (12.0, 24.0), arrowprops={"arrowstyle": "-"})
    for corner in ((5.0, -40.0, 95.0, 45.0), (-40.0, 5.0, 45.0, 95.0)):
        right.add_patch(Rectangle(corner[:2], *corner[2:], facecolor="#fff5f5", edgecolor="none"))
    right.text(55.0, -22.0, "D4: one side lifted off", ha="center", color=RED)
    right.text(-20.0, 52.0, "D4", ha="center", color=RED)
    right.add_patch(Rectangle((-40.0, -40.0), 45.0, 45.0, facecolor="#edf2f7", edgecolor="none"))
    right.text(-18.0, -22.0, "D5: both\nlifted off", ha="center", color=GREY)
    right.set(xlim=(-40.0, 100.0), ylim=(-40.0, 100.0), xticks=[], yticks=[])
    right.set(xlabel="medial: gap ←   → load", ylabel="lateral: gap ←   → load")
    figure.tight_layout()
    return figure


def finite_elements() -> plt.Figure:
    """Pressure of springs and of finite elements in one pose, and the force of both along a walking cycle."""
    scene = cc.load_scene("knee_fem")
    models = {"elastic foundation": cc.ElasticFoundation(scene, (60, 45)), "finite elements": cc.FiniteElements(scene)}
    cycles = reference_motion_cycles(scene, ())[:1]
    poses = reference_poses(models["finite elements"], cycles, tolerance_n=0.1)[0][0]
    pressed = poses[models["finite elements"](poses, ["Fy_med", "Fy_lat"]).sum(axis=1).argmin()]
    figure, shown = plt.subplots(1, 3, figsize=(11.0, 3.6), width_ratios=(1.0, 1.0, 1.3), layout="constrained")
    maps = {name: model.pressure_maps(pressed) for name, model in models.items()}
    largest = max(one.pressures_mpa.max() for both in maps.values() for one in both)
    for axis, (name, both) in zip(shown, maps.items(), strict=False):
        for one in both:
            x, _, z = one.centres_mm.T
            image = axis.tripcolor(-z, -x, one.pressures_mpa, vmin=0.0, vmax=largest, cmap="magma_r", shading="gouraud")
        force = sum(one.forces_n.sum() for one in both)
        axis.set(title=f"{name}: {force:,.0f} N", aspect="equal", xlim=(-30, 30), ylim=(-18, 8), xlabel="lateral [mm]")
    shown[0].set(ylabel="anterior [mm]")
    figure.colorbar(image, ax=shown[:2], label="pressure [MPa]", location="bottom", aspect=40)
    for name, model in models.items():
        sides = model(poses, ["Fy_med", "Fy_lat"])
        for side, style, force in zip(("medial", "lateral"), ("-", "--"), -sides.T, strict=True):
            shown[2].plot(force, style, color=RED if name == "finite elements" else BLUE, label=f"{name}, {side}")
    shown[2].set(xlabel="walking cycle [%]", ylabel="force at the same poses [N]", ylim=(0.0, None))
    shown[2].legend(fontsize=8)
    return figure


if __name__ == "__main__":
    main()
