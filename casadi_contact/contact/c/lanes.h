/* BLOCK numbers worked on at once: vectors of GCC and clang, which any instruction set can carry out. */
typedef double Lanes __attribute__((vector_size(8 * BLOCK)));
typedef long long Mask __attribute__((vector_size(8 * BLOCK)));

INLINE Lanes all(double x) { return x - (Lanes){0.0}; }
INLINE Lanes pick(Mask mask, Lanes a, Lanes b) { return (Lanes)((mask & (Mask)a) | (~mask & (Mask)b)); }
INLINE Lanes larger_of(Lanes a, Lanes b) { return pick(a > b, a, b); }
INLINE Lanes smaller_of(Lanes a, Lanes b) { return pick(a < b, a, b); }
INLINE double sum_of(Lanes x) { return (x[0] + x[1]) + (x[2] + x[3]); }

INLINE Lanes root(Lanes x) {
  Lanes y;
  for (int l = 0; l < BLOCK; l++) y[l] = sqrt(x[l]);
  return y;
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
