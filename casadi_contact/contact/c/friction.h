/* Friction and dissipation at points of the fixed surface, for kernels with MOVING: the formulas of contact/friction.py.
 * motion: the twist of the moving body about the fixed origin, then the coefficients, which are inputs where there are
 * COEFFICIENTS. The force p A of a point does V p A to the wrench; derivatives by the LOCALS are those by the motion. */
enum { STATIC, DYNAMIC, VISCOUS, TRANSITION, DISSIPATION };

typedef struct {
  Lanes n[3], slide[3], drag[6], area; /* drag: (slide, c x slide) times the area, which is the size of V at rest */
  Lanes approach, whole, rise, bend;   /* S and its derivatives */
  Lanes f[3];                          /* f and its derivatives by the square of the speed */
  Lanes by[4], by_1[4], by_2[4];       /* f by coefficients, then by the square as well, and by the transition as well */
} Slip;

INLINE void slip_at(const double *motion, const Lanes c[3], const Lanes n[3], Lanes area, Slip *s) {
  const double *k = motion + 6, by_1 = 1.0 / k[TRANSITION], by_2 = by_1 * by_1, by_3 = by_1 * by_2;
  const Lanes turned[3] = {all(motion[3]), all(motion[4]), all(motion[5])};
  Lanes w[6], x, y, u, above, kinetic[3], sticking[3], dry[3];
  Mask slow;
  twist_of(c, turned, w); /* omega x c, behind */
  for (int i = 0; i < 3; i++) w[i] = motion[i] + w[3 + i];
  s->approach = -dot_of(n, w), s->area = area;
  for (int i = 0; i < 3; i++) s->n[i] = n[i], s->slide[i] = w[i] + s->approach * n[i];
  twist_of(s->slide, c, s->drag);
  for (int i = 0; i < 6; i++) s->drag[i] *= area;
  y = 1.0 + k[DISSIPATION] * s->approach;
  u = smaller_of(larger_of(2.0 * y, all(0.0)), all(1.0));
  s->whole = pick(y < 0.5, 0.5 * u * u * u * (6.0 - 8.0 * u + 3.0 * u * u), y);
  s->rise = u * u * (18.0 - 32.0 * u + 15.0 * u * u);
  s->bend = 24.0 * u * (3.0 - 8.0 * u + 5.0 * u * u);
  x = by_2 * dot_of(s->slide, s->slide), slow = x < 1.0;
  above = 1.0 / larger_of(x, all(1.0)), y = root(above), u = 1.0 / (1.0 + x * (1.0 / 3.0));
  kinetic[0] = pick(slow, 0.125 * (15.0 - 10.0 * x + 3.0 * x * x), y);
  kinetic[1] = pick(slow, 0.25 * (3.0 * x - 5.0), -0.5 * y * above);
  kinetic[2] = pick(slow, all(0.75), 0.75 * y * above * above);
  sticking[0] = 16.0 / 9.0 * u * u, sticking[1] = -2.0 / 3.0 * u * sticking[0], sticking[2] = -u * sticking[1];
  for (int i = 0; i < 3; i++) {
    kinetic[i] -= sticking[i];
    dry[i] = k[DYNAMIC] * kinetic[i] + k[STATIC] * sticking[i];
  }
  s->f[0] = by_1 * dry[0] + k[VISCOUS], s->f[1] = by_3 * dry[1], s->f[2] = by_2 * by_3 * dry[2];
  s->by[STATIC] = by_1 * sticking[0], s->by[DYNAMIC] = by_1 * kinetic[0];
  s->by[VISCOUS] = all(1.0), s->by[TRANSITION] = -by_2 * (dry[0] + 2.0 * x * dry[1]);
  s->by_1[STATIC] = by_3 * sticking[1], s->by_1[DYNAMIC] = by_3 * kinetic[1];
  s->by_1[VISCOUS] = all(0.0), s->by_1[TRANSITION] = -by_2 * by_2 * (3.0 * dry[1] + 2.0 * x * dry[2]);
  s->by_2[STATIC] = -by_2 * (sticking[0] + 2.0 * x * sticking[1]), s->by_2[VISCOUS] = all(0.0);
  s->by_2[DYNAMIC] = -by_2 * (kinetic[0] + 2.0 * x * kinetic[1]);
  s->by_2[TRANSITION] = 2.0 * by_3 * (dry[0] + 5.0 * x * dry[1] + 2.0 * x * x * dry[2]);
}

/* V at rest becomes V. */
INLINE void rub(const Slip *s, Lanes load[6]) {
  for (int k = 0; k < 6; k++) load[k] = s->whole * (load[k] - s->f[0] * s->drag[k]);
}

/* Of weights . V: w = force's + moment's x c, across the normal y, along the slide b; without S steady, and its slope */
typedef struct {
  Lanes y[3], b, steady, slope[3];
} Pull;

/* weights . V from what it is at rest, and its derivatives by the locals */
INLINE Lanes pull_of(const Slip *s, const double *motion, const Lanes c[3], const double weights[6], Lanes rest, Pull *of,
                     Lanes by[LOCALS]) {
  const Lanes moment[3] = {all(weights[3]), all(weights[4]), all(weights[5])}, once = motion[6 + DISSIPATION] * s->rise;
  Lanes w[6], along, gradient[3];
  twist_of(c, moment, w);
  for (int i = 0; i < 3; i++) w[i] = weights[i] + w[3 + i];
  along = dot_of(w, s->n), of->b = s->area * dot_of(w, s->slide), of->steady = rest - s->f[0] * of->b;
  for (int i = 0; i < 3; i++) {
    of->y[i] = s->area * (w[i] - along * s->n[i]);
    of->slope[i] = -s->f[0] * of->y[i] - 2.0 * s->f[1] * of->b * s->slide[i];
    gradient[i] = s->whole * of->slope[i] - once * of->steady * s->n[i];
  }
  twist_of(gradient, c, by);
  for (int j = 6; j < LOCALS; j++) {
    by[j] = j < 6 + DISSIPATION ? -s->whole * of->b * s->by[j - 6] : s->rise * s->approach * of->steady;
  }
  return s->whole * of->steady;
}

/* + force times the derivatives of each component of V, from V at rest */
INLINE void add_rub_slopes(const Slip *s, const double *motion, const Lanes c[3], const Lanes rest[6], Lanes force,
                           Lanes slopes[6][LOCALS]) {
  for (int k = 0; k < 6; k++) {
    const double one[6] = {k == 0, k == 1, k == 2, k == 3, k == 4, k == 5};
    Lanes by[LOCALS];
    Pull of;
    pull_of(s, motion, c, one, rest[k], &of, by);
    for (int b = 0; b < LOCALS; b++) slopes[k][b] += force * by[b];
  }
}

/* + force times the second derivatives of weights . V by the locals, the upper triangle */
INLINE void add_rub_curvature(const Slip *s, const double *motion, const Lanes c[3], const Pull *of, Lanes force,
                              Lanes h[LOCALS][LOCALS]) {
  const double damping = motion[6 + DISSIPATION];
  const Lanes once = damping * s->rise, twice = damping * damping * s->bend * of->steady, pull = s->whole * of->b;
  const Lanes slid = s->rise * s->approach, twice_slid = damping * s->bend * s->approach + s->rise;
  Lanes rows[3][6], column[6];
  for (int i = 0; i < 3; i++) {
    Lanes row[3];
    for (int j = 0; j < 3; j++) {
      const Lanes across = (i == j ? 1.0 : 0.0) - s->n[i] * s->n[j];
      const Lanes both = s->slide[i] * of->y[j] + of->y[i] * s->slide[j];
      const Lanes bent = 4.0 * s->f[2] * of->b * s->slide[i] * s->slide[j] + 2.0 * s->f[1] * (of->b * across + both);
      const Lanes leant = s->n[i] * of->slope[j] + of->slope[i] * s->n[j];
      row[j] = force * (twice * s->n[i] * s->n[j] - s->whole * bent - once * leant);
    }
    twist_of(row, c, rows[i]);
  }
  for (int j = 0; j < 6; j++) {
    const Lanes of_force[3] = {rows[0][j], rows[1][j], rows[2][j]};
    twist_of(of_force, c, column);
    for (int i = 0; i <= j; i++) h[i][j] += column[i];
  }
  for (int j = 6; j < LOCALS; j++) {
    const int k = j - 6, last = 6 + DISSIPATION;
    Lanes mixed[3];
    for (int i = 0; i < 3; i++) {
      const Lanes on_slide = s->by[k % 4] * of->y[i] + 2.0 * s->by_1[k % 4] * of->b * s->slide[i];
      mixed[i] = j == last ? slid * of->slope[i] - twice_slid * of->steady * s->n[i]
                           : once * of->b * s->by[k] * s->n[i] - s->whole * on_slide;
      mixed[i] *= force;
    }
    twist_of(mixed, c, column);
    for (int i = 0; i < 6; i++) h[i][j] += column[i];
    if (j < last) h[j][last] -= force * slid * of->b * s->by[k], h[j][6 + TRANSITION] -= force * pull * s->by_2[k];
    else h[j][j] += force * s->bend * s->approach * s->approach * of->steady;
  }
}
