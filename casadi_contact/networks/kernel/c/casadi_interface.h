/* The interface of casadi.external for BATCH poses. Sparsity patterns are filled in when they are asked for. */
#define casadi_int long long int
#define PATTERN(rows, columns) (3 + (columns) * BATCH + (rows) * (columns) * BATCH)

#if defined(_WIN32)
#define EXPORT __declspec(dllexport)
#else
#define EXPORT
#endif

INLINE int work_of(int inputs, int outputs, casadi_int *sz_arg, casadi_int *sz_res, casadi_int *sz_iw,
                   casadi_int *sz_w) {
  if (sz_arg) *sz_arg = inputs;
  if (sz_res) *sz_res = outputs;
  if (sz_iw) *sz_iw = 0;
  if (sz_w) *sz_w = 0;
  return 0;
}

INLINE const casadi_int *dense(casadi_int rows, casadi_int *pattern) {
  pattern[0] = rows, pattern[1] = BATCH, pattern[2] = 1;
  return pattern;
}

INLINE const casadi_int *empty(casadi_int rows, casadi_int columns, casadi_int *pattern) {
  pattern[0] = rows, pattern[1] = columns;
  for (casadi_int j = 0; j <= columns; j++) pattern[2 + j] = 0;
  return pattern;
}

INLINE const casadi_int *block_diagonal(casadi_int rows, casadi_int columns, casadi_int *pattern) {
  casadi_int *start = pattern + 2, *row = start + columns * BATCH + 1;
  pattern[0] = rows * BATCH, pattern[1] = columns * BATCH;
  for (casadi_int j = 0; j <= columns * BATCH; j++) start[j] = j * rows;
  for (casadi_int j = 0; j < columns * BATCH; j++) {
    for (casadi_int i = 0; i < rows; i++) row[j * rows + i] = (j / columns) * rows + i;
  }
  return pattern;
}

/* d(Jacobian, stacked by columns)/d(pose): of each pose's block of the Jacobian, by that pose alone. */
INLINE const casadi_int *second_blocks(casadi_int rows, casadi_int *pattern) {
  casadi_int *start = pattern + 2, *row = start + 6 * BATCH + 1;
  pattern[0] = rows * BATCH * 6 * BATCH, pattern[1] = 6 * BATCH;
  for (casadi_int c = 0; c <= 6 * BATCH; c++) start[c] = c * 6 * rows;
  for (casadi_int c = 0; c < 6 * BATCH; c++) {
    casadi_int i = c / 6;
    for (casadi_int j = 0; j < 6; j++) {
      for (casadi_int k = 0; k < rows; k++) *row++ = (6 * i + j) * rows * BATCH + rows * i + k;
    }
  }
  return pattern;
}

/* CasADi leaves out what it does not need. */
INLINE void value_of_all(const double *pose, double *loads, double *roots) {
  double f[LOADS + 1], s[ROOTS + 1];
  if (BATCH > 1) {
    values_of(BATCH, pose, loads, roots);
    return;
  }
  guarded_value(pose, loads ? loads : f, roots ? roots : s);
}

/* Blocks by columns, as CasADi stores them, or (transpose) d(adjoint product)/d(adjoint). */
INLINE void jacobian_of_all(const double *pose, double *loads, double *roots, int transpose) {
  if (!loads && !roots) return;
  for (int i = 0; i < BATCH; i++) {
    double f[LOADS + 1], s[ROOTS + 1], df[LOADS + 1][6], ds[ROOTS + 1][6];
    guarded_jacobian(pose + 6 * i, f, s, df, ds);
    for (int j = 0; j < 6; j++) {
      if (loads) {
        for (int k = 0; k < LOADS; k++) loads[6 * LOADS * i + (transpose ? 6 * k + j : LOADS * j + k)] = df[k][j];
      }
      if (roots) {
        for (int k = 0; k < ROOTS; k++) roots[6 * ROOTS * i + (transpose ? 6 * k + j : ROOTS * j + k)] = ds[k][j];
      }
    }
  }
}

/* adjoint·Jacobian; a seed that CasADi leaves out is zero */
INLINE void adjoint_of_all(const double *pose, const double *loads_seed, const double *roots_seed, double *product) {
  if (!product) return;
  for (int i = 0; i < BATCH; i++) {
    double f[LOADS + 1], s[ROOTS + 1], df[LOADS + 1][6], ds[ROOTS + 1][6];
    guarded_jacobian(pose + 6 * i, f, s, df, ds);
    for (int j = 0; j < 6; j++) {
      double sum = 0.0;
      if (loads_seed) {
        for (int k = 0; k < LOADS; k++) sum += loads_seed[LOADS * i + k] * df[k][j];
      }
      if (roots_seed) {
        for (int k = 0; k < ROOTS; k++) sum += roots_seed[ROOTS * i + k] * ds[k][j];
      }
      product[6 * i + j] = sum;
    }
  }
}

INLINE void hessian_of_all(const double *pose, const double *loads_seed, const double *roots_seed, double *hessian) {
  static const double zeros[LOADS + ROOTS] = {0};
  if (!hessian) return;
  for (int i = 0; i < BATCH; i++) {
    guarded_hessian(pose + 6 * i, loads_seed ? loads_seed + LOADS * i : zeros,
                   roots_seed ? roots_seed + ROOTS * i : zeros, hessian + 36 * i);
  }
}

/* The Hessian of one output after the other, as second_blocks has them. */
INLINE void seconds_of_all(const double *pose, double *loads, double *roots) {
  for (int i = 0; i < BATCH; i++) {
    for (int m = 0; m < LOADS + ROOTS; m++) {
      int root = m >= LOADS, rows = root ? ROOTS : LOADS, k = root ? m - LOADS : m;
      double *to = root ? roots : loads, weights[LOADS + ROOTS] = {0}, hessian[36];
      if (!to) continue;
      weights[m] = 1.0;
      guarded_hessian(pose + 6 * i, weights, weights + LOADS, hessian);
      for (int e = 0; e < 36; e++) to[(36 * i + e) * rows + k] = hessian[e];
    }
  }
}
