/* Arrays of poses (n x 6), for NumPy; an array that is 0 is left out. The last block is filled up with its last pose:
 * no result depends on how many poses there are, or on which thread takes them. */
#if defined(_WIN32)
#define ARRAYS __declspec(dllexport)
#else
#define ARRAYS
#endif

INLINE void block_values(long long n, const double *poses, double (*loads)[LANES], double (*roots)[LANES]) {
  double filled[6 * LANES];
  for (int l = 0; l < LANES; l++) memcpy(filled + 6 * l, poses + 6 * (l < n ? l : n - 1), 6 * sizeof(double));
  guarded_batch(filled, loads, roots);
}

ARRAYS void array_values(long long n, const double *poses, double *loads, double *roots) {
  for (long long i = 0; i < n; i += LANES) {
    double f[LOADS + 1][LANES], s[ROOTS + 1][LANES];
    block_values(n - i, poses + 6 * i, f, s);
    for (int l = 0; l < LANES && i + l < n; l++) {
      for (int k = 0; loads && k < LOADS; k++) loads[LOADS * (i + l) + k] = f[k][l];
      for (int k = 0; roots && k < ROOTS; k++) roots[ROOTS * (i + l) + k] = s[k][l];
    }
  }
}

ARRAYS void array_jacobians(long long n, const double *poses, double *loads, double *slopes) {
  for (long long i = 0; i < n; i++) {
    double s[ROOTS + 1], ds[ROOTS + 1][6];
    guarded_jacobian(poses + 6 * i, loads + LOADS * i, s, (double(*)[6])(slopes + 6 * LOADS * i), ds);
  }
}

/* Of the weighted sum of loads, weights (n x LOADS): 6 x 6 in full. */
ARRAYS void array_hessians(long long n, const double *poses, const double *weights, double *hessians) {
  const double none[ROOTS + 1] = {0};
  for (long long i = 0; i < n; i++) guarded_hessian(poses + 6 * i, weights + LOADS * i, none, hessians + 36 * i);
}
