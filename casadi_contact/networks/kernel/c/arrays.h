/* Arrays of poses (n x 6), for NumPy; an array that is 0 is left out. */
void array_jacobians(long long n, const double *poses, double *loads, double *slopes) {
  for (long long i = 0; i < n; i++) {
    guarded_jacobian(poses + 6 * i, loads + LOADS * i, 0, (double(*)[6])(slopes + 6 * LOADS * i), 0);
  }
}

/* Of the weighted sum of loads, weights (n x LOADS): 6 x 6 in full. */
void array_hessians(long long n, const double *poses, const double *weights, double *hessians) {
  for (long long i = 0; i < n; i++) guarded_hessian(poses + 6 * i, weights + LOADS * i, 0, hessians + 36 * i);
}
