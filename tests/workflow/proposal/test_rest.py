"""Loads under which a proposed joint comes to rest."""

import casadi_contact as cc
from casadi_contact.workflow.proposal.joint import Joint
from casadi_contact.workflow.proposal.rest import rest_loads


def test_a_force_that_turns_presses_down_where_the_scene_names_no_other_way():
    loads = rest_loads(cc.load_scene("hip"), Joint("other", ("contact",), ""), 100.0)
    assert loads == {"Fx": 0.0, "Fy": -100.0, "Fz": 0.0}
