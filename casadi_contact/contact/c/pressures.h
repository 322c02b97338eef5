/* Pressure moments of many poses, for NumPy: area, integrals of p and p c, largest depth (contact/pressures.py).
 * A model defines patch_moments, with derivatives by the twist of the moving body about t; here they are by pose. */
void foundation_moments(long long n, const double *poses, double *values, double *slopes) {
  for (long long i = 0; i < n; i++) {
    const Frame frame = frame_of(poses + 6 * i);
    for (int p = 0; p < PATCHES; p++) {
      const long long row = i * PATCHES + p;
      double by_twist[6][6] = {{0.0}};
      memset(values + 6 * row, 0, 6 * sizeof(double));
      patch_moments(p, poses + 6 * i, &frame, values + 6 * row, by_twist);
      for (int k = 0; k < 6; k++) row_by_pose(&frame, by_twist[k], slopes + 36 * row + 6 * k);
    }
  }
}
