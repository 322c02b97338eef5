"""Pictures: contact as it is in a pose or a motion, and how well smooth surfaces fit their meshes.

A wrong sign or frame shows here first.
"""

from casadi_contact.show.contact_picture import MOST_FRAMES, draw_contact, loads_text, pressures_text
from casadi_contact.show.contact_pose import contact_pose
from casadi_contact.show.fit_picture import draw_fit, surface_fits
from casadi_contact.show.view import PictureAxis, View, view_of

__all__ = [
    "MOST_FRAMES",
    "PictureAxis",
    "View",
    "contact_pose",
    "draw_contact",
    "draw_fit",
    "loads_text",
    "pressures_text",
    "surface_fits",
    "view_of",
]
