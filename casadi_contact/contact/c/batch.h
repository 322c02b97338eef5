/* Many poses in one call, for NumPy: what is 0 is left out. Derivatives are by pose. */
INLINE void put_gap(const Frame *frame, const PatchLoads *of, long long row, double *gaps, double *slopes) {
  gaps[row] = of->gap;
  row_by_pose(frame, of->gap_slope, slopes + 6 * row);
}

/* gaps, gap_slopes: of patches that carry no normal load, others keep what is there */
ARRAYS void foundation_wrenches(long long n, const double *poses, double *wrenches, double *slopes, int *cut,
                                double *gaps, double *gap_slopes) {
  for (long long i = 0; i < n; i++) {
    const Frame frame = frame_of(poses + 6 * i);
    for (int p = 0; p < PATCHES; p++) {
      const long long row = i * PATCHES + p;
      PatchLoads of;
      double by_force[3];
      patch_loads(p, poses + 6 * i, &frame, slopes ? FIRST : VALUE, gaps != 0, 0, &of);
      memcpy(wrenches + 6 * row, of.wrench, sizeof of.wrench);
      if (slopes) {
        for (int k = 0; k < 6; k++) row_by_pose(&frame, of.stiffness[k], slopes + 36 * row + 6 * k);
      }
      cut[row] = of.cut;
      if (gaps && !(normal_load(p, of.wrench, by_force) > 0.0)) {
        if (!of.apart) patch_loads(p, poses + 6 * i, &frame, GAPS, 1, 0, &of);
        put_gap(&frame, &of, row, gaps, gap_slopes);
      }
    }
  }
}

ARRAYS void foundation_gaps(long long n, const double *poses, double *gaps, double *slopes) {
  for (long long i = 0; i < n; i++) {
    const Frame frame = frame_of(poses + 6 * i);
    for (int p = 0; p < PATCHES; p++) {
      const long long row = i * PATCHES + p;
      PatchLoads of;
      patch_loads(p, poses + 6 * i, &frame, GAPS, 1, 0, &of);
      put_gap(&frame, &of, row, gaps, slopes);
    }
  }
}
