/* Many poses in one call, for NumPy: what is 0 is left out. Derivatives are by pose. */
ARRAYS void foundation_wrenches(long long n, const double *poses, double *wrenches, double *slopes, int *cut) {
  for (long long i = 0; i < n; i++) {
    const Frame frame = frame_of(poses + 6 * i);
    for (int p = 0; p < PATCHES; p++) {
      const long long row = i * PATCHES + p;
      PatchLoads of;
      patch_loads(p, poses + 6 * i, &frame, slopes ? FIRST : VALUE, 0, &of);
      memcpy(wrenches + 6 * row, of.wrench, sizeof of.wrench);
      if (slopes) {
        for (int k = 0; k < 6; k++) row_by_pose(&frame, of.stiffness[k], slopes + 36 * row + 6 * k);
      }
      cut[row] = of.cut;
    }
  }
}

ARRAYS void foundation_gaps(long long n, const double *poses, double *gaps, double *slopes) {
  for (long long i = 0; i < n; i++) {
    const Frame frame = frame_of(poses + 6 * i);
    for (int p = 0; p < PATCHES; p++) {
      const long long row = i * PATCHES + p;
      PatchLoads of;
      patch_loads(p, poses + 6 * i, &frame, GAPS, 0, &of);
      gaps[row] = of.gap;
      row_by_pose(&frame, of.gap_slope, slopes + 6 * row);
    }
  }
}
