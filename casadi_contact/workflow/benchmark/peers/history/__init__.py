"""History models [EF15 §1]: they follow a motion in time, and know a pose by what came before it.

Contact loads here depend on the pose alone; what the past adds is knowledge of the motion. An optimiser asks for
single poses, which have no past: then a motion that rests at the pose stands in for it.
"""
