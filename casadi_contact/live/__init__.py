"""The joint in a page: its kernel as WebAssembly, the bodies in 3-D, sliders, loads and a cycle, in one HTML file."""

from casadi_contact.live.joint_page import joint_page, write_joint_page

__all__ = ["joint_page", "write_joint_page"]
