/* BLOCK numbers worked on at once: vectors of GCC and clang, which any instruction set can carry out. */
typedef double Lanes __attribute__((vector_size(8 * BLOCK)));
typedef long long Mask __attribute__((vector_size(8 * BLOCK)));
#if defined(__clang__)
#define SHUFFLED(x, y, i, j, k, l) __builtin_shufflevector(x, y, i, j, k, l)
#else
#define SHUFFLED(x, y, i, j, k, l) __builtin_shuffle(x, y, (Mask){i, j, k, l})
#endif

INLINE Lanes all(double x) { return x - (Lanes){0.0}; }
INLINE Lanes pick(Mask mask, Lanes a, Lanes b) { return (Lanes)((mask & (Mask)a) | (~mask & (Mask)b)); }
INLINE Lanes larger_of(Lanes a, Lanes b) { return pick(a > b, a, b); }
INLINE Lanes smaller_of(Lanes a, Lanes b) { return pick(a < b, a, b); }
INLINE Lanes size_of(Lanes x) { return larger_of(x, -x); }
INLINE double sum_of(Lanes x) { return (x[0] + x[1]) + (x[2] + x[3]); }

/* The sum of each of four rows */
INLINE Lanes sums_of(const Lanes row[BLOCK]) {
  const Lanes a = SHUFFLED(row[0], row[1], 0, 4, 2, 6) + SHUFFLED(row[0], row[1], 1, 5, 3, 7);
  const Lanes b = SHUFFLED(row[2], row[3], 0, 4, 2, 6) + SHUFFLED(row[2], row[3], 1, 5, 3, 7);
  return SHUFFLED(a, b, 0, 1, 4, 5) + SHUFFLED(a, b, 2, 3, 6, 7);
}

/* Four rows become four columns. */
INLINE void transpose(const Lanes row[BLOCK], Lanes column[BLOCK]) {
  const Lanes a = SHUFFLED(row[0], row[1], 0, 4, 2, 6), b = SHUFFLED(row[0], row[1], 1, 5, 3, 7);
  const Lanes c = SHUFFLED(row[2], row[3], 0, 4, 2, 6), d = SHUFFLED(row[2], row[3], 1, 5, 3, 7);
  column[0] = SHUFFLED(a, c, 0, 1, 4, 5), column[1] = SHUFFLED(b, d, 0, 1, 4, 5);
  column[2] = SHUFFLED(a, c, 2, 3, 6, 7), column[3] = SHUFFLED(b, d, 2, 3, 6, 7);
}

INLINE Lanes lanes_at(const double *x) {
  Lanes y;
  memcpy(&y, x, sizeof y);
  return y;
}

INLINE int any(Mask mask) { return ((mask[0] | mask[1]) | (mask[2] | mask[3])) != 0; }

INLINE Lanes root(Lanes x) {
  Lanes y;
  for (int l = 0; l < BLOCK; l++) y[l] = sqrt(x[l]);
  return y;
}

/* Nearest whole numbers, below 2^51 */
INLINE Lanes nearest_whole(Lanes x) {
  const double whole = 6755399441055744.0;
  return (x + whole) - whole;
}

INLINE Lanes dot_of(const Lanes a[3], const Lanes b[3]) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }

/* (f, arm x f): what a force does to the velocities of a twist */
INLINE void twist_of(const Lanes f[3], const Lanes arm[3], Lanes twist[6]) {
  for (int i = 0; i < 3; i++) twist[i] = f[i];
  twist[3] = arm[1] * f[2] - arm[2] * f[1];
  twist[4] = arm[2] * f[0] - arm[0] * f[2];
  twist[5] = arm[0] * f[1] - arm[1] * f[0];
}

INLINE Lanes product_sum(int n, const Lanes *x, const Lanes *y) {
  Lanes even = all(0.0), odd = all(0.0);
  int i = 0;
  for (; i + 2 <= n; i += 2) even += x[i] * y[i], odd += x[i + 1] * y[i + 1];
  return even + (i < n ? x[i] * y[i] + odd : odd);
}
