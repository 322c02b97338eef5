"""The way until something holds is found to a small part of a step, and is the reach where it never does."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from casadi_contact.contact.way_until import way_until

REACH = 15.0


@given(st.lists(st.floats(0.0, 2.0 * REACH), max_size=6), st.floats(0.05, 4.0))
def test_what_holds_from_a_place_on_is_found_there(begins, step):
    begins = np.array(begins)
    ways = way_until(lambda which, way: way >= begins[which], len(begins), step, REACH)
    missed = ways - np.minimum(begins, REACH)
    assert (missed >= 0.0).all()
    assert (missed <= step / 2**11).all()


def test_nobody_is_asked_again_before_the_others_are_found():
    asked = []

    def holds(which, way):
        asked.append(which.tolist())
        return way >= np.array([0.5, 3.5])[which]

    way_until(holds, 2, 1.0, 5.0)
    assert asked[:4] == [[0, 1], [1], [1], [1]]
