"""A ball on a ground with two dips and a ridge between them, where every load is carried in three places."""

import numpy as np

import casadi_contact as cc

STIFFNESS, DIP_MM, RADIUS_MM = 2000.0, 5.0, 20.0


def height(x):
    """y = (x² - a²)²/(4·a²·R): dips at ±a, of radius of curvature R/2, and a ridge at 0 of radius R."""
    return (x**2 - DIP_MM**2) ** 2 / (4.0 * DIP_MM**2 * RADIUS_MM)


def slope(x):
    """dy/dx."""
    return x * (x**2 - DIP_MM**2) / (DIP_MM**2 * RADIUS_MM)


def wrenches(poses):
    """On the ground, -∇U of U = (k/3)·d³, d = h(x) - y."""
    x, y = poses[:, 0], poses[:, 1]
    force = STIFFNESS * np.maximum(height(x) - y, 0.0) ** 2
    found = np.zeros((len(poses), 1, 6))
    found[:, 0, 0], found[:, 0, 1] = force * slope(x), -force
    return found


def gaps(poses):
    """Along y."""
    return (poses[:, 1] - height(poses[:, 0]))[:, None]


def contact_model():
    """As a user's own."""
    return cc.CallableModel(cc.load_scene("sphere_on_plane"), wrenches, gaps)
