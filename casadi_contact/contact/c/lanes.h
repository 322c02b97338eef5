/* BLOCK numbers worked on at once, of MOST_LANES as many as a register holds but no fewer than four: vectors of GCC and
 * clang, which any instruction set can carry out. */
#if MOST_LANES >= 8 && defined(__AVX512F__)
#define BLOCK 8
#else
#define BLOCK 4
#endif
#if defined(__AVX__) /* where compilers take whole vectors apart */
#include <immintrin.h>
#endif
typedef double Lanes __attribute__((vector_size(8 * BLOCK)));
typedef long long Mask __attribute__((vector_size(8 * BLOCK)));
typedef int Whole __attribute__((vector_size(4 * BLOCK)));
typedef double Four __attribute__((vector_size(32)));
typedef long long FourPlaces __attribute__((vector_size(32)));
#if defined(__clang__)
#define SHUFFLED(x, y, i, j, k, l) __builtin_shufflevector(x, y, i, j, k, l)
#else
#define SHUFFLED(x, y, i, j, k, l) __builtin_shuffle(x, y, (FourPlaces){i, j, k, l})
#endif

INLINE Lanes all(double x) { return x - (Lanes){0.0}; }
INLINE Lanes pick(Mask mask, Lanes a, Lanes b) { return (Lanes)((mask & (Mask)a) | (~mask & (Mask)b)); }
#if defined(__AVX__) && BLOCK == 8 /* the same in one instruction, which compilers do not see */
INLINE Lanes larger_of(Lanes a, Lanes b) { return _mm512_max_pd(a, b); }
INLINE Lanes smaller_of(Lanes a, Lanes b) { return _mm512_min_pd(a, b); }
#elif defined(__AVX__)
INLINE Lanes larger_of(Lanes a, Lanes b) { return _mm256_max_pd(a, b); }
INLINE Lanes smaller_of(Lanes a, Lanes b) { return _mm256_min_pd(a, b); }
#else
INLINE Lanes larger_of(Lanes a, Lanes b) { return pick(a > b, a, b); }
INLINE Lanes smaller_of(Lanes a, Lanes b) { return pick(a < b, a, b); }
#endif
INLINE Lanes size_of(Lanes x) { return larger_of(x, -x); }

INLINE Lanes joined(const Four part[BLOCK / 4]) {
#if BLOCK == 8
  return _mm512_insertf64x4(_mm512_castpd256_pd512(part[0]), part[1], 1);
#else
  return part[0];
#endif
}

INLINE Four part_of(Lanes x, int k) {
#if BLOCK == 8
  return k ? _mm512_extractf64x4_pd(x, 1) : _mm512_castpd512_pd256(x);
#else
  (void)k;
  return x;
#endif
}

INLINE double sum_of(Lanes x) {
#if BLOCK == 8
  const Four y = part_of(x, 0) + part_of(x, 1);
#else
  const Four y = x;
#endif
  return (y[0] + y[1]) + (y[2] + y[3]);
}

INLINE void transpose(const Four row[4], Four column[4]) {
  const Four a = SHUFFLED(row[0], row[1], 0, 4, 2, 6), b = SHUFFLED(row[0], row[1], 1, 5, 3, 7);
  const Four c = SHUFFLED(row[2], row[3], 0, 4, 2, 6), d = SHUFFLED(row[2], row[3], 1, 5, 3, 7);
  column[0] = SHUFFLED(a, c, 0, 1, 4, 5), column[1] = SHUFFLED(b, d, 0, 1, 4, 5);
  column[2] = SHUFFLED(a, c, 2, 3, 6, 7), column[3] = SHUFFLED(b, d, 2, 3, 6, 7);
}

/* BLOCK rows become four columns, */
INLINE void to_columns(const Four row[BLOCK], Lanes column[4]) {
  Four part[BLOCK / 4][4];
  for (int k = 0; k < BLOCK / 4; k++) transpose(row + 4 * k, part[k]);
  for (int i = 0; i < 4; i++) {
    Four both[BLOCK / 4];
    for (int k = 0; k < BLOCK / 4; k++) both[k] = part[k][i];
    column[i] = joined(both);
  }
}

/* and columns rows. */
INLINE void to_rows(const Lanes column[4], Four row[BLOCK]) {
  for (int k = 0; k < BLOCK / 4; k++) {
    Four part[4];
    for (int i = 0; i < 4; i++) part[i] = part_of(column[i], k);
    transpose(part, row + 4 * k);
  }
}

INLINE Four four_at(const double *x) {
  Four y;
  memcpy(&y, x, sizeof y);
  return y;
}

INLINE Four four_singles_at(const float *x) {
#if defined(__AVX__)
  return _mm256_cvtps_pd(_mm_loadu_ps(x));
#else
  return (Four){x[0], x[1], x[2], x[3]};
#endif
}

INLINE Lanes lanes_at(const double *x) {
  Lanes y;
  memcpy(&y, x, sizeof y);
  return y;
}

INLINE Lanes singles_at(const float *x) {
#if BLOCK == 8
  return _mm512_cvtps_pd(_mm256_loadu_ps(x));
#else
  return four_singles_at(x);
#endif
}

/* One bit for each lane */
INLINE unsigned bits_of(Mask mask) {
#if BLOCK == 8 && defined(__AVX512DQ__)
  return _mm512_movepi64_mask((__m512i)mask);
#elif BLOCK == 4 && defined(__AVX__)
  return (unsigned)_mm256_movemask_pd((__m256d)mask);
#else
  unsigned bits = 0;
  for (int l = 0; l < BLOCK; l++) bits |= (unsigned)(mask[l] & 1) << l;
  return bits;
#endif
}

/* One for each of the first `count` lanes, or for all */
INLINE unsigned lowest_bits(int count) { return (1u << (count < BLOCK ? count : BLOCK)) - 1; }

INLINE int first_bit(unsigned bits) { return __builtin_ctz(bits); }

INLINE int any(Mask mask) { return bits_of(mask) != 0; }

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

INLINE Whole whole_of(Lanes x) { return __builtin_convertvector(x, Whole); }

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
