/* Elastic foundations as kernels: what every contact model here shares. A model defines patch_loads: the wrench of one
 * patch, its derivatives by the twist of the moving body about t (velocity of t; angular velocity, fixed axes) and,
 * where it is apart and the gap is asked for, the gap; from these come named loads and root loads, with derivatives by
 * the pose. */
enum { VALUE, FIRST, SECOND, GAPS };

typedef struct {
  double wrench[6], stiffness[6][6], curvature[6][6]; /* curvature: of the weighted wrench, [a][b]: b acts last */
  double gap, gap_slope[6], gap_curvature[6][6];      /* with_gap: where it is apart, and always with order GAPS */
  int apart;                                          /* there is no contact */
  int cut;                                            /* contact reaches the rim */
#if MOVING /* by the motion, see friction.h: of the wrench, and of the weighted one, there also by twist and then by it */
  double by_motion[6][LOCALS], gradient[LOCALS], mixed[6][LOCALS], local[LOCALS][LOCALS];
#endif
} PatchLoads;

INLINE double larger(double a, double b) { return a > b ? a : b; }
INLINE double smaller(double a, double b) { return a < b ? a : b; }
INLINE double bounded_by(double x, double low, double high) { return x < low ? low : (x > high ? high : x); }
INLINE double dot3(const double a[3], const double b[3]) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }

/* ---- pressure at a depth, see scenes/material.py */
#define STIFFNESS_AT_ZERO (MODULUS / THICKNESS)

#if LOGARITHMIC
#define TANGENT_STRAIN 0.9

/* log(1 - s) for 0 <= s <= 0.9: 1 - s = m / 2^k with sqrt(1/2) <= m < sqrt(2), and the series of atanh. */
INLINE Lanes log_of_rest(Lanes s) {
  Lanes scale = all(1.0), whole = all(0.0), f, square, sum = all(1.0 / 21.0);
  for (int k = 1; k <= 3; k++) {
    const Mask small = 1.0 - s < 1.4142135623730951 * ldexp(1.0, -k);
    scale = pick(small, all(ldexp(1.0, k)), scale), whole = pick(small, all(k), whole);
  }
  f = ((scale - 1.0) - scale * s) / ((scale + 1.0) - scale * s);
  square = f * f;
  for (int k = 19; k >= 3; k -= 2) sum = sum * square + 1.0 / k;
  return 2.0 * f * (1.0 + square * sum) - 0.6931471805599453 * whole;
}

INLINE Lanes strain_at(Lanes depth) {
  return smaller_of(larger_of(depth * (1.0 / THICKNESS), all(0.0)), all(TANGENT_STRAIN));
}

INLINE Lanes pressure_at(Lanes depth) {
  const Lanes beyond = larger_of(depth - TANGENT_STRAIN * THICKNESS, all(0.0));
  return MODULUS / (THICKNESS * (1.0 - TANGENT_STRAIN)) * beyond - MODULUS * log_of_rest(strain_at(depth));
}

INLINE Lanes pressure_slope_at(Lanes depth) {
  return pick(depth > 0.0, MODULUS / (THICKNESS * (1.0 - strain_at(depth))), all(0.0));
}

INLINE Lanes pressure_bend_at(Lanes depth) {
  const Lanes rest = THICKNESS * (1.0 - strain_at(depth));
  return pick((depth > 0.0) & (depth < TANGENT_STRAIN * THICKNESS), MODULUS / (rest * rest), all(0.0));
}
#else
INLINE Lanes pressure_at(Lanes depth) { return STIFFNESS_AT_ZERO * larger_of(depth, all(0.0)); }
INLINE Lanes pressure_slope_at(Lanes depth) { return pick(depth > 0.0, all(STIFFNESS_AT_ZERO), all(0.0)); }
INLINE Lanes pressure_bend_at(Lanes depth) { return 0.0 * depth; }
#endif

/* ---- twists */

/* Terms of second derivatives by twist that come from turning: force = sum of w G, arms[a][b] = sum of w G_a arm_b. */
INLINE void add_turning(const double force[3], const double arms[3][3], double h[6][6]) {
  const double trace = arms[0][0] + arms[1][1] + arms[2][2];
  for (int a = 0; a < 3; a++) for (int b = 0; b < 3; b++) h[3 + a][3 + b] += arms[a][b] - (a == b ? trace : 0.0);
  for (int a = 0; a < 3; a++) { /* (e_a x force)_b */
    const int b = (a + 1) % 3, c = (a + 2) % 3;
    h[a][3 + b] -= force[c], h[3 + b][a] -= force[c];
    h[a][3 + c] += force[b], h[3 + c][a] += force[b];
  }
}

/* Row of derivatives by twist -> by pose: the rotations turn the body about the frame's axes. */
INLINE void row_by_pose(const Frame *frame, const double twist[6], double row[6]) {
  for (int j = 0; j < 3; j++) {
    row[j] = twist[j];
    row[3 + j] = twist[3] * frame->e[j][0] + twist[4] * frame->e[j][1] + twist[5] * frame->e[j][2];
  }
}

/* Second derivatives [a][b] by twist, b last, added as those by pose. An axis turns only with the angles before it, so
 * for j <= i the pose's derivatives are e_j^T M e_i. */
INLINE void add_by_pose(const Frame *frame, const double m[6][6], double *hessian) {
  double half[6][6], column[6], turned[6];
  for (int a = 0; a < 6; a++) row_by_pose(frame, m[a], half[a]);
  for (int i = 0; i < 6; i++) {
    for (int a = 0; a < 6; a++) column[a] = half[a][i];
    row_by_pose(frame, column, turned);
    for (int j = 0; j <= i; j++) {
      hessian[VARIABLES * i + j] += turned[j];
      if (i != j) hessian[VARIABLES * j + i] += turned[j];
    }
  }
}
