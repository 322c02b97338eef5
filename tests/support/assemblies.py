"""Assemblies of free bodies."""

import numpy as np

import casadi_contact as cc
from casadi_contact.optimisation.assembly.joints import Body, free_joint


def free_bodies(ground, start, **parts):
    """Bodies by their poses (6,) [mm, rad] at rest in the ground, without mass."""
    made = [free_joint(body, ground, pose) for body, pose in start.items()]
    table = {name: coordinate for coordinates, _ in made for name, coordinate in coordinates.items()}
    return cc.Assembly("free", ground, np.zeros(3), table, {b: Body() for b in start}, [j for _, j in made], **parts)
