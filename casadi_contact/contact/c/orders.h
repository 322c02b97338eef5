/* patch_loads from the model's loads_of_patch: one function for each order, not inlined, so that compiling is quick and
 * patches share them. */
FUNCTION void loads_value(int patch, const double *pose, const Frame *frame, int with_gap, PatchLoads *out) {
  loads_of_patch(patch, pose, frame, VALUE, with_gap, 0, out);
}

FUNCTION void loads_first(int patch, const double *pose, const Frame *frame, int with_gap, PatchLoads *out) {
  loads_of_patch(patch, pose, frame, FIRST, with_gap, 0, out);
}

FUNCTION void loads_second(int patch, const double *pose, const Frame *frame, int with_gap, const double *weights,
                           PatchLoads *out) {
  loads_of_patch(patch, pose, frame, SECOND, with_gap, weights, out);
}

FUNCTION void loads_gaps(int patch, const double *pose, const Frame *frame, PatchLoads *out) {
  loads_of_patch(patch, pose, frame, GAPS, 1, 0, out);
}

INLINE void patch_loads(int patch, const double *pose, const Frame *frame, int order, int with_gap,
                        const double *weights, PatchLoads *out) {
  if (order == VALUE) loads_value(patch, pose, frame, with_gap, out);
  if (order == FIRST) loads_first(patch, pose, frame, with_gap, out);
  if (order == SECOND) loads_second(patch, pose, frame, with_gap, weights, out);
  if (order == GAPS) loads_gaps(patch, pose, frame, out);
}
