/* Root loads of patches from those s of their parts, first[p] to first[p + 1] - 1 (surrogate/patch/surrogate.py); slopes
 * may be 0, else slopes[i] = d root / d s_i. */
#define LEAST_ROOT 1e-9

FUNCTION void patch_roots(const int *first, const double *s, double *roots, double *slopes) {
  for (int p = 0; p < PATCHES; p++) {
    double squares = 0.0, nearest = -INFINITY, sum = 0.0;
    if (first[p + 1] - first[p] == 1) {
      roots[p] = s[first[p]];
      if (slopes) slopes[first[p]] = 1.0;
      continue;
    }
    for (int i = first[p]; i < first[p + 1]; i++) {
      const double apart = s[i] < -LEAST_ROOT ? s[i] : -LEAST_ROOT;
      if (s[i] > 0.0) squares += s[i] * s[i];
      if (apart > nearest) nearest = apart;
    }
    for (int i = first[p]; i < first[p + 1]; i++) {
      const double share = nearest / (s[i] < -LEAST_ROOT ? s[i] : -LEAST_ROOT);
      sum += share * share;
    }
    roots[p] = squares > 0.0 ? sqrt(squares) : nearest / sqrt(sum);
    for (int i = first[p]; slopes && i < first[p + 1]; i++) {
      const double apart = roots[p] / (s[i] < -LEAST_ROOT ? s[i] : -LEAST_ROOT);
      slopes[i] = squares > 0.0 ? (s[i] > 0.0 ? s[i] / roots[p] : 0.0) : apart * apart * apart;
    }
  }
}
