"""A scene that is like another one: ``like = "knee"`` and only what differs.

Tables are taken over key by key, [tolerances] as a whole; left out, those of the loads that are asked for.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from casadi_contact.scenes.shapes.checks import fail


def completed(tables: Mapping[str, Any], ready: Callable[[str], Mapping[str, Any]]) -> Mapping[str, Any]:
    """The tables with those of the ready-made scene that they are like; ready gives these by name.

    Raises ValueError for a name that is no ready-made scene's.
    """
    if "like" not in tables:
        return tables
    name = tables["like"]
    if not isinstance(name, str):
        raise fail("like", name, "the name of a ready-made scene")
    whole = dict(completed(ready(name), ready))
    for key, value in tables.items():
        before = whole.get(key)
        if isinstance(before, Mapping) and isinstance(value, Mapping) and key != "tolerances":
            value = {**before, **value}
        whole[key] = value
    del whole["like"]
    if "tolerances" not in tables and isinstance(whole["loads"], Mapping):
        names = whole["loads"]["names"]
        whole["tolerances"] = {load: value for load, value in whole["tolerances"].items() if load in names}
    return whole
