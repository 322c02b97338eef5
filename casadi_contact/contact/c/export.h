/* 1 where a patch is overlapped by more than its layer's thickness, or where surfaces that have passed through each
 * other are not pressed: there the root load of a pressed patch is that of its gap. */
INLINE int outside(const double *pose, const double *parts) {
  const Frame frame = frame_of(pose);
  for (int p = 0; p < PATCHES; p++) {
    PatchLoads of;
    if (!(parts[p] > 0.0)) continue;
    patch_loads(p, pose, &frame, GAPS, 0, &of);
    if (!(of.gap >= -THICKNESS) || fabs(parts[p] + GAP_SLOPE * of.gap) <= 1e-9 * parts[p]) return 1;
  }
  return 0;
}
