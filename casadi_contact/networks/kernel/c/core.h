/* Layers of small networks, with sizes that are compile-time constants after inlining.
 * Weights of a layer with I inputs and O outputs: (I + 1) rows of O numbers, the biases first; O is a multiple of 8,
 * filled up with zeros. Loops run over outputs, so that they vectorise without reordering any sum. */

/* Some tunings use half of AVX-512's registers. Vectors that fill whole ones would then be written and read by halves: a
 * foundation takes a quarter longer, a batch of networks half as long again. */
#if defined(__AVX512F__) && defined(__GNUC__) && !defined(__clang__) && (!defined(MOST_LANES) || MOST_LANES > 4)
#if __GNUC__ >= 9
#pragma GCC target("prefer-vector-width=512")
#endif
#endif

#include <math.h>
#include <stdint.h>
#include <string.h>
#if defined(__AVX512F__) && defined(__GNUC__)
#include <immintrin.h>
#endif

#if defined(__GNUC__)
#define INLINE static inline __attribute__((always_inline, unused))
#define FUNCTION static __attribute__((noinline, unused))
#define ALIGNED __attribute__((aligned(64))) /* to lines of the cache, as whole registers are read */
#define UNROLL _Pragma("GCC unroll 32")
#else
#define INLINE static inline
#define FUNCTION static
#define ALIGNED
#define UNROLL
#endif

/* Complete unrolling before vectorisation would leave scalar code. */
#if defined(__GNUC__) && !defined(__clang__)
#define KEEP_LOOP _Pragma("GCC unroll 1")
#else
#define KEEP_LOOP
#endif

#define WIDTH 8 /* every padded layer is a multiple of this */

/* Networks of one shape are evaluated in pairs, a step of each in turn: no step waits for the one before it. */
#define SIDE 2
#define EACH UNROLL for (int p = 0; p < n; p++)

/* Offset of a pose from the middle of the learned range; so far out that no square overflows, all is flat. */
INLINE double bounded(double offset) { return offset > 1e100 ? 1e100 : (offset < -1e100 ? -1e100 : offset); }

/* By its bits, so that no compiler option removes the question. */
INLINE int all_finite(int n, const double *x) {
  const uint64_t infinity = UINT64_C(0x7ff0000000000000);
  int finite = 1;
  for (int j = 0; j < n; j++) {
    uint64_t bits;
    memcpy(&bits, x + j, sizeof bits);
    finite &= (bits & infinity) != infinity;
  }
  return finite;
}

INLINE int finite_pose(const double *pose) { return all_finite(6, pose); }

INLINE void fill_nan(int n, double *values) {
  for (int i = 0; i < n; i++) values[i] = NAN;
}

/* As many doubles as a register holds, the widest part of a layer whose sums all stay in registers, and whether networks
 * in pairs are faster than one by one: their values, and their slopes as well. */
#if defined(__AVX512F__)
#define BYTES 64
#define NEURONS_AT_ONCE 32
#define VALUES_IN_PAIRS 1
#define SLOPES_IN_PAIRS 1
#elif defined(__AVX__)
#define BYTES 32
#define NEURONS_AT_ONCE 24
#define VALUES_IN_PAIRS 1
#define SLOPES_IN_PAIRS 0
#else
#define BYTES 16
#define NEURONS_AT_ONCE 8
#define VALUES_IN_PAIRS 0
#define SLOPES_IN_PAIRS 0
#endif
#if defined(__GNUC__)
typedef double Vector __attribute__((vector_size(BYTES)));
typedef double Stored __attribute__((vector_size(BYTES), aligned(8), may_alias));
typedef uint64_t Bits __attribute__((vector_size(BYTES)));
#else
typedef double Vector, Stored;
typedef uint64_t Bits;
#endif
#define VECTOR ((int)(sizeof(Vector) / sizeof(double)))

/* Inputs in turn go to one of two sums, so that one does not wait for the other. */
INLINE void layer_block(int biased, int inputs, int width, int stride, const double *w, const double *a, double *z) {
  const int vectors = width / VECTOR;
  const Vector zero = {0};
  Vector even[32], odd[32];
  int j = 0;
  UNROLL for (int i = 0; i < vectors; i++) {
    even[i] = odd[i] = zero;
    if (biased) even[i] = *(const Stored *)(w + i * VECTOR);
  }
  for (; j + 1 < inputs; j += 2) {
    const double *row = w + (j + 1) * stride, *next = row + stride;
    UNROLL for (int i = 0; i < vectors; i++) {
      even[i] += *(const Stored *)(row + i * VECTOR) * a[j];
      odd[i] += *(const Stored *)(next + i * VECTOR) * a[j + 1];
    }
  }
  if (j < inputs) {
    const double *row = w + (j + 1) * stride;
    UNROLL for (int i = 0; i < vectors; i++) even[i] += *(const Stored *)(row + i * VECTOR) * a[j];
  }
  UNROLL for (int i = 0; i < vectors; i++) *(Stored *)(z + i * VECTOR) = even[i] + odd[i];
}

INLINE void layer(int biased, int inputs, int outputs, const double *w, const double *a, double *z) {
  int i = 0;
  for (; i + NEURONS_AT_ONCE <= outputs; i += NEURONS_AT_ONCE) {
    layer_block(biased, inputs, NEURONS_AT_ONCE, outputs, w + i, a, z + i);
  }
  if (outputs - i >= 24) layer_block(biased, inputs, 24, outputs, w + i, a, z + i);
  else if (outputs - i >= 16) layer_block(biased, inputs, 16, outputs, w + i, a, z + i);
  else if (outputs - i >= 8) layer_block(biased, inputs, 8, outputs, w + i, a, z + i);
}

#define affine(...) layer(1, __VA_ARGS__) /* z = W a + b */
#define linear(...) layer(0, __VA_ARGS__) /* z = W a */

INLINE double sum_of_lanes(const double *sum) {
  return ((sum[0] + sum[4]) + (sum[1] + sum[5])) + ((sum[2] + sum[6]) + (sum[3] + sum[7]));
}

INLINE Vector loaded(const double *a) { return *(const Stored *)a; }

INLINE double dot(int n, const double *u, const double *v) {
  Vector sum[WIDTH / VECTOR];
  double lanes[WIDTH];
  UNROLL for (int l = 0; l < WIDTH; l += VECTOR) sum[l / VECTOR] = loaded(u + l) * loaded(v + l);
  for (int i = WIDTH; i < n; i += WIDTH) {
    UNROLL for (int l = 0; l < WIDTH; l += VECTOR) sum[l / VECTOR] += loaded(u + i + l) * loaded(v + i + l);
  }
  memcpy(lanes, sum, sizeof lanes);
  return sum_of_lanes(lanes);
}

/* q = W^T r, the rows of W in turn */
INLINE void transposed(int inputs, int outputs, const double *w, const double *r, double *q) {
  for (int j = 0; j < inputs; j++) q[j] = dot(outputs, w + (j + 1) * outputs, r);
}

INLINE void times(int n, const double *u, const double *v, double *product) {
  for (int i = 0; i < n; i += VECTOR) *(Stored *)(product + i) = loaded(u + i) * loaded(v + i);
}

/* Sums of weight_i Z_i Z_i^T over the lower triangle, in parts that `curved` adds up; column t of Z begins at z + t n */
INLINE void curvature(int inputs, int n, const double *weight, const double *z, double (*sums)[WIDTH]) {
  for (int t = 0; t < inputs; sums += ++t) {
    UNROLL for (int l = 0; l < WIDTH; l += VECTOR) {
      Vector sum[16] = {{0}}; /* else compilers warn */
      UNROLL for (int u = 0; u <= t; u++) sum[u] = loaded(sums[u] + l);
      for (int i = l; i < n; i += WIDTH) {
        const Vector scaled = loaded(weight + i) * loaded(z + t * n + i);
        UNROLL for (int u = 0; u <= t; u++) sum[u] += scaled * loaded(z + u * n + i);
      }
      UNROLL for (int u = 0; u <= t; u++) *(Stored *)(sums[u] + l) = sum[u];
    }
  }
}

INLINE void curved(int inputs, double (*sums)[WIDTH], double *h) {
  for (int t = 0; t < inputs; t++) for (int u = 0; u <= t; u++, sums++) h[t * inputs + u] += sum_of_lanes(sums[0]);
}

/* row A and H += A^T M A, of M the lower triangle, for A of n rows */
INLINE void through(int n, const double *row, double (*a)[6], double *product) {
  for (int j = 0; j < 6; j++) product[j] = 0.0;
  for (int i = 0; i < n; i++) for (int j = 0; j < 6; j++) product[j] += row[i] * a[i][j];
}

INLINE void add_through(int n, const double *m, double (*a)[6], double *hessian) {
  for (int i = 0; i < n; i++) {
    double row[6] = {0};
    for (int k = 0; k < n; k++) for (int j = 0; j < 6; j++) row[j] += (k < i ? m[i * n + k] : m[k * n + i]) * a[k][j];
    for (int k = 0; k < 6; k++) for (int j = 0; j < 6; j++) hessian[6 * k + j] += a[i][k] * row[j];
  }
}

/* 1/sqrt(x) for 1 <= x < 1e300 to 2 units in the last place: a start (error < 2^-14, or from the exponent's bits 3.5 %,
 * which takes one step of third order more) and one step of fourth order. Faster than a square root and a division. */
INLINE Vector reciprocal_root(Vector x) {
  Vector y, miss;
#if defined(__AVX512F__) && defined(__GNUC__)
  y = (Vector)_mm512_rsqrt14_pd((__m512d)x);
#else
  Bits bits;
  memcpy(&bits, &x, sizeof bits);
  bits = UINT64_C(0x5fe6eb50c7b537a9) - (bits >> 1);
  memcpy(&y, &bits, sizeof y);
  miss = 1.0 - x * y * y;
  y += y * miss * (0.5 + miss * 0.375);
#endif
  miss = 1.0 - x * y * y;
  return y + y * miss * (0.5 + miss * (0.375 + miss * 0.3125));
}

INLINE Vector smaller_vector(Vector a, Vector b) {
#if defined(__AVX512F__) && defined(__GNUC__)
  return (Vector)_mm512_min_pd((__m512d)a, (__m512d)b); /* which compilers do not see */
#elif defined(__GNUC__)
  const Bits within = (Bits)(a < b);
  return (Vector)((within & (Bits)a) | (~within & (Bits)b));
#else
  return a < b ? a : b;
#endif
}

/* exp(-x) for x >= 0: 2^n exp(r) with |r| <= ln(2)/2, Taylor's terms up to r^12. */
INLINE Vector decay(Vector x) {
  const Vector zero = {0}, y = -smaller_vector(x, zero + 700.0), shifted = y * 1.4426950408889634 + 6755399441055744.0;
  const Vector n = shifted - 6755399441055744.0;
  const Vector r = (y - n * 0.693147180369123816490) - n * 1.90821492927058770002e-10;
  const double factorials[] = {1, 1, 2, 6, 24, 120, 720, 5040, 40320, 362880, 3628800, 39916800, 479001600};
  Vector p = zero + 1.0 / factorials[12], power;
  Bits bits;
  UNROLL for (int k = 11; k >= 0; k--) p = p * r + 1.0 / factorials[k];
  memcpy(&bits, &shifted, sizeof bits);
  bits = (bits + 1023) << 52;
  memcpy(&power, &bits, sizeof power);
  return p * power;
}

/* tanh(z) = ±(1 - exp(-2|z|))/(1 + exp(-2|z|)), with the sign of z */
INLINE Vector hyperbolic_tangent(Vector z) {
  const uint64_t sign = UINT64_C(0x8000000000000000);
  Bits of_z, bits;
  Vector size, t;
  memcpy(&of_z, &z, sizeof z);
  bits = of_z & ~sign;
  memcpy(&size, &bits, sizeof size);
  t = decay(2.0 * size);
  size = (1.0 - t) / (1.0 + t);
  memcpy(&bits, &size, sizeof size);
  bits |= of_z & sign;
  memcpy(&size, &bits, sizeof size);
  return size;
}
