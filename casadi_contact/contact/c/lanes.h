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
#if defined(__clang__)
#define MIXED(places, x, y, ...) __builtin_shufflevector(x, y, __VA_ARGS__)
#else
#define MIXED(places, x, y, ...) __builtin_shuffle(x, y, (places){__VA_ARGS__})
#endif
#define SHUFFLED(x, y, ...) MIXED(Mask, x, y, __VA_ARGS__)
#if BLOCK == 8 /* in each half */
#define EVENS 0, 8, 2, 10, 4, 12, 6, 14
#define ODDS 1, 9, 3, 11, 5, 13, 7, 15
#define FRONTS 0, 1, 8, 9, 4, 5, 12, 13
#define BACKS 2, 3, 10, 11, 6, 7, 14, 15
#else
#define EVENS 0, 4, 2, 6
#define ODDS 1, 5, 3, 7
#define FRONTS 0, 1, 4, 5
#define BACKS 2, 3, 6, 7
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

/* Four numbers of a lane, and of the fourth after it where there are eight */
INLINE Lanes joined(Four first, Four second) {
#if BLOCK == 8
  return _mm512_insertf64x4(_mm512_castpd256_pd512(first), second, 1);
#else
  (void)second;
  return first;
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
  const Four y = BLOCK == 8 ? part_of(x, 0) + part_of(x, 1) : part_of(x, 0);
  return (y[0] + y[1]) + (y[2] + y[3]);
}

/* Four rows, joined, become columns, and columns rows. */
INLINE void transpose(const Lanes row[4], Lanes column[4]) {
  const Lanes a = SHUFFLED(row[0], row[1], EVENS), b = SHUFFLED(row[0], row[1], ODDS);
  const Lanes c = SHUFFLED(row[2], row[3], EVENS), d = SHUFFLED(row[2], row[3], ODDS);
  column[0] = SHUFFLED(a, c, FRONTS), column[1] = SHUFFLED(b, d, FRONTS);
  column[2] = SHUFFLED(a, c, BACKS), column[3] = SHUFFLED(b, d, BACKS);
}

/* BLOCK rows become four columns, */
INLINE void to_columns(const Four row[BLOCK], Lanes column[4]) {
  Lanes rows[4];
  for (int l = 0; l < 4; l++) rows[l] = joined(row[l], row[BLOCK - 4 + l]);
  transpose(rows, column);
}

/* and columns rows. */
INLINE void to_rows(const Lanes column[4], Four row[BLOCK]) {
  Lanes rows[4];
  transpose(column, rows);
  for (int l = 0; l < BLOCK; l++) row[l] = part_of(rows[l % 4], l / 4);
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

/* BLOCK rows in single precision become four columns: turned before they are widened, which takes longest. */
INLINE void singles_to_columns(const float *const at[BLOCK], Lanes column[4]) {
#if BLOCK == 8
  __m256 row[4], a, b, c, d;
  for (int l = 0; l < 4; l++) row[l] = _mm256_loadu2_m128(at[l + 4], at[l]);
  a = _mm256_unpacklo_ps(row[0], row[1]), b = _mm256_unpacklo_ps(row[2], row[3]);
  c = _mm256_unpackhi_ps(row[0], row[1]), d = _mm256_unpackhi_ps(row[2], row[3]);
  column[0] = _mm512_cvtps_pd(_mm256_shuffle_ps(a, b, 0x44)), column[1] = _mm512_cvtps_pd(_mm256_shuffle_ps(a, b, 0xee));
  column[2] = _mm512_cvtps_pd(_mm256_shuffle_ps(c, d, 0x44)), column[3] = _mm512_cvtps_pd(_mm256_shuffle_ps(c, d, 0xee));
#else
  Four row[BLOCK];
  for (int l = 0; l < BLOCK; l++) row[l] = four_singles_at(at[l]);
  to_columns(row, column);
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
