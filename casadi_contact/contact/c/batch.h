/* Many poses in one call, for NumPy: what is 0 is left out. Derivatives are by pose. Gaps are those of patches that carry
 * no normal load, and without wrenches those of all. */
void foundation_loads(long long n, const double *poses, double *wrenches, double *slopes, int *cut, double *gaps,
                             double *gap_slopes) {
  for (long long row = 0; row < n * PATCHES; row++) {
    const double *pose = poses + 6 * (row / PATCHES);
    const Frame frame = frame_of(pose);
    const int p = (int)(row % PATCHES);
    PatchLoads of;
    double by_force[3];
    of.apart = 0;
    if (wrenches) {
      patch_loads(p, pose, &frame, slopes ? FIRST : VALUE, gaps != 0, 0, &of);
      memcpy(wrenches + 6 * row, of.wrench, sizeof of.wrench);
      for (int k = 0; slopes && k < 6; k++) row_by_pose(&frame, of.stiffness[k], slopes + 36 * row + 6 * k);
      cut[row] = of.cut;
    }
    if (gaps && !(wrenches && normal_load(p, of.wrench, by_force) > 0.0)) {
      if (!of.apart) patch_loads(p, pose, &frame, GAPS, 1, 0, &of);
      gaps[row] = of.gap;
      row_by_pose(&frame, of.gap_slope, gap_slopes + 6 * row);
    }
  }
}
