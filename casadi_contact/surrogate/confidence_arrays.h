/* Of many poses, for NumPy; errors (n x LOADS) may be 0. */
ARRAYS void array_confidence(long long n, const double *poses, double *validity, double *errors) {
  for (long long i = 0; i < n; i += LANES) {
    double f[LOADS + 1][LANES], s[ROOTS + 1][LANES];
    block_values(n - i, poses + 6 * i, f, s);
    for (int l = 0; l < LANES && i + l < n; l++) {
      double parts[ROOTS];
      for (int k = 0; k < ROOTS; k++) parts[k] = s[k][l];
      validity[i + l] = confidence_at(poses + 6 * (i + l), parts, errors ? errors + LOADS * (i + l) : 0);
    }
  }
}
