/* The interface of casadi.external for FRAMES poses of VARIABLES numbers; sparsity patterns are filled in when asked for. */
#include <stdlib.h>
#define casadi_int long long int
#ifndef FRAMES
#define FRAMES 1
#endif
#ifndef VARIABLES
#define VARIABLES 6
#endif

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

/* Room for a pattern of so many columns and entries, kept; it starts with its numbers of rows and columns. */
INLINE casadi_int *pattern_of(casadi_int rows, casadi_int columns, casadi_int entries, casadi_int **kept) {
  if (!*kept) *kept = malloc((3 + columns + entries) * sizeof(casadi_int));
  if (*kept) (*kept)[0] = rows, (*kept)[1] = columns;
  return *kept;
}

INLINE const casadi_int *dense(casadi_int rows, casadi_int **kept) {
  casadi_int *pattern = pattern_of(rows, FRAMES, 0, kept);
  if (pattern) pattern[2] = 1;
  return pattern;
}

/* Without entries: of an input that is of no use here, or of a derivative by it. */
INLINE const casadi_int *empty(casadi_int rows, casadi_int columns, casadi_int **kept) {
  casadi_int *pattern = pattern_of(rows, columns, 0, kept);
  for (casadi_int j = 0; pattern && j <= columns; j++) pattern[2 + j] = 0;
  return pattern;
}

/* Of each pose a block. */
INLINE const casadi_int *blocks(casadi_int rows, casadi_int columns, casadi_int **kept) {
  const casadi_int n = FRAMES, all = columns * n;
  casadi_int *pattern = pattern_of(rows * n, all, rows * all, kept), *start = pattern + 2, *row = start + all + 1;
  for (casadi_int j = 0; pattern && j <= all; j++) start[j] = j * rows;
  for (casadi_int j = 0; pattern && j < all; j++) {
    for (casadi_int i = 0; i < rows; i++) row[j * rows + i] = (j / columns) * rows + i;
  }
  return pattern;
}

/* d(Jacobian, stacked by columns)/d(pose): of each pose's block of the Jacobian, by that pose alone. */
INLINE const casadi_int *second_blocks(casadi_int rows, casadi_int **kept) {
  const casadi_int n = FRAMES, all = VARIABLES * n;
  casadi_int *pattern = pattern_of(rows * n * all, all, VARIABLES * rows * all, kept), *start = pattern + 2;
  casadi_int *row = start + all + 1;
  for (casadi_int c = 0; pattern && c <= all; c++) start[c] = c * VARIABLES * rows;
  for (casadi_int c = 0; pattern && c < all; c++) {
    for (casadi_int j = 0; j < VARIABLES; j++) {
      for (casadi_int k = 0; k < rows; k++) *row++ = (VARIABLES * (c / VARIABLES) + j) * rows * n + rows * (c / VARIABLES) + k;
    }
  }
  return pattern;
}

/* Blocks by columns, as CasADi stores them, or (transpose) d(adjoint product)/d(adjoint). */
INLINE void block_of(int rows, double (*jacobian)[VARIABLES], double *to, int transpose) {
  for (int j = 0; j < VARIABLES; j++) {
    for (int k = 0; k < rows; k++) to[transpose ? VARIABLES * k + j : rows * j + k] = jacobian[k][j];
  }
}

INLINE void jacobian_of_all(const double *pose, double *loads, double *roots, int transpose) {
  const casadi_int n = loads || roots ? FRAMES : 0;
  for (casadi_int i = 0; i < n; i++) {
    double f[LOADS + 1], s[ROOTS + 1], df[LOADS + 1][VARIABLES], ds[ROOTS + 1][VARIABLES];
    guarded_jacobian(pose + VARIABLES * i, loads ? f : 0, roots ? s : 0, df, ds);
    if (loads) block_of(LOADS, df, loads + VARIABLES * LOADS * i, transpose);
    if (roots) block_of(ROOTS, ds, roots + VARIABLES * ROOTS * i, transpose);
  }
}

/* adjoint·Jacobian; a seed that CasADi leaves out is zero */
INLINE void adjoint_of_all(const double *pose, const double *loads_seed, const double *roots_seed, double *product) {
  const casadi_int n = product ? FRAMES : 0;
  for (casadi_int i = 0; i < n; i++) {
    double f[LOADS + 1], s[ROOTS + 1], df[LOADS + 1][VARIABLES], ds[ROOTS + 1][VARIABLES];
    guarded_jacobian(pose + VARIABLES * i, loads_seed ? f : 0, roots_seed ? s : 0, df, ds);
    for (int j = 0; j < VARIABLES; j++) product[VARIABLES * i + j] = 0.0;
    for (int k = 0; k < LOADS + ROOTS; k++) {
      const double *seeds = k < LOADS ? loads_seed : roots_seed, *row = k < LOADS ? df[k] : ds[k - LOADS];
      const double seed = seeds ? seeds[k < LOADS ? LOADS * i + k : ROOTS * i + k - LOADS] : 0.0;
      for (int j = 0; j < VARIABLES && seed != 0.0; j++) { /* what has no weight may be NaN */
        product[VARIABLES * i + j] += seed * row[j];
      }
    }
  }
}

INLINE void hessian_of_all(const double *pose, const double *loads_seed, const double *roots_seed, double *hessian) {
  const casadi_int n = hessian ? FRAMES : 0;
  for (casadi_int i = 0; i < n; i++) {
    guarded_hessian(pose + VARIABLES * i, loads_seed ? loads_seed + LOADS * i : 0, roots_seed ? roots_seed + ROOTS * i : 0,
                    hessian + VARIABLES * VARIABLES * i);
  }
}

/* The Hessian of one output after the other, as second_blocks has them. */
INLINE void seconds_of_all(const double *pose, double *loads, double *roots) {
  const casadi_int n = FRAMES;
  for (casadi_int i = 0; i < n; i++) {
    for (int m = 0; m < LOADS + ROOTS; m++) {
      int root = m >= LOADS, rows = root ? ROOTS : LOADS, k = root ? m - LOADS : m;
      double *to = root ? roots : loads, weights[LOADS + ROOTS] = {0}, hessian[VARIABLES * VARIABLES];
      if (!to) continue;
      weights[m] = 1.0;
      guarded_hessian(pose + VARIABLES * i, root ? 0 : weights, root ? weights + LOADS : 0, hessian);
      for (int e = 0; e < VARIABLES * VARIABLES; e++) to[(VARIABLES * VARIABLES * i + e) * rows + k] = hessian[e];
    }
  }
}
