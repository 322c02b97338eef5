"""Meshes of joints made from formulas, and their analysis by a proposal."""

import numpy as np

from casadi_contact.geometry.mesh import checked_mesh
from casadi_contact.workflow.proposal.frame import frame_of
from casadi_contact.workflow.proposal.joint_geometry import joint_geometry
from tests.support.meshes import ball_mesh, cap_mesh, groove, sheet_mesh, shell_mesh, unit

POLE, DOWN = unit(np.array([0.2, 0.8, 0.5])), np.array([0.0, -1.0, 0.0])


def analysed(moving, fixed, **options):
    """Placement, patches, joint and frame of two meshes."""
    geometry = joint_geometry({"moving": moving, "fixed": fixed}, axes=options.get("axes"))
    return geometry.placement, geometry.patches, geometry.joint, frame_of(geometry, **options)


def ball_in_cup(move=lambda points: points):
    ball, cup = ball_mesh(16.0, 2.5), shell_mesh(16.4, 22.0, 2.0, 1.3, POLE)
    return [checked_mesh(name, move(v), f) for name, (v, f) in (("ball", ball), ("cup", cup))]


def button_on_groove(height=22.0, aside=0.0):
    (button, faces), valley = cap_mesh(22.0, 1.5, 0.7), sheet_mesh(40.0, 2.0, groove)
    return checked_mesh("button", button + np.array([0.0, height, aside]), faces), checked_mesh("groove", *valley)


def condyles_in_dishes(radius=20.0, dish=32.0, side=22.0):
    """Two balls as a femur's condyles, the middle of both at the origin, just above dishes that are wider."""
    (ball, faces), out = cap_mesh(radius, 1.5, 0.8), np.array([0.0, 0.0, side])

    def dishes(x, z):
        across = np.minimum(x**2 + (np.abs(z) - side) ** 2, 20.0**2)
        return dish - np.sqrt(dish**2 - across) - radius - 0.05

    condyles = np.vstack([ball - out, ball + out]), np.vstack([faces, faces + len(ball)])
    return condyles, sheet_mesh(76.0, 2.0, dishes)
