/* 1 where a patch is overlapped by more than its layer's thickness, or where surfaces have passed through each other:
 * there the force on the fixed body points the way in which the gap opens (they are pressed from behind), or there is
 * none, and the root load of a pressed patch is that of its gap. Also where squares of distances overflow. */
INLINE int outside(const double *pose) {
  double parts[PATCHES];
  const Frame frame = frame_of(pose);
  for (int j = 0; j < 3; j++) {
    if (fabs(pose[j]) > 1e100) return 1;
  }
  kernel_value(pose, 0, parts);
  for (int p = 0; p < PATCHES; p++) {
    PatchLoads near, pressed;
    if (!(parts[p] > 0.0)) continue;
    patch_loads(p, pose, &frame, GAPS, 1, 0, &near);
    patch_loads(p, pose, &frame, VALUE, 0, 0, &pressed);
    if (!(near.gap >= -THICKNESS) || fabs(parts[p] + GAP_SLOPE * near.gap) <= 1e-9 * parts[p]) return 1;
    if (dot3(near.gap_slope, pressed.wrench) > 0.0) return 1;
  }
  return 0;
}
