/* Pressure moments of a ball in a cup: the formulas of contact/cup.py. */
INLINE void turn_vector(const Place *p, const double x[3], double scale, double out[3]) {
  for (int i = 0; i < 3; i++) out[i] = scale * (p->frame[0][i] * x[0] + p->frame[1][i] * x[1] + p->frame[2][i] * x[2]);
}

/* Area's derivative: R^2/|d_x| times the integral of d_b over the edge. */
INLINE void area_slope(const Place *p, double slope[3]) {
  const double w = larger(CUP_RADIUS - p->length * p->edge, LEAST_SINE), rise = CUP_RADIUS / w, lean = p->length / w;
  const double arc = arc_at(p, p->edge), across = sqrt(larger(1.0 - p->edge * p->edge, 0.0));
  const double along[3] = {2.0 * arc * (rise * p->edge - lean), 2.0 * rise * across * sin(arc), 0.0};
  turn_vector(p, along, CUP_RADIUS * CUP_RADIUS / (p->length * rise), slope);
}

/* Largest depth: s + w - R in the direction nearest to the ball. */
INLINE double largest_depth(const Place *p, double slope[3]) {
  double e[3], flat[3], size, s, w;
  nearest_direction(p, e, flat, &size);
  s = dot3(e, p->b);
  w = sqrt(larger(BALL_RADIUS * BALL_RADIUS - p->length * p->length + s * s, LEAST_SINE));
  for (int i = 0; i < 3; i++) slope[i] = (1.0 + s / w) * e[i] - p->b[i] / w;
  return s + w - CUP_RADIUS;
}

FUNCTION void patch_moments(int patch, const double *pose, const Frame *frame, double value[6], double slope[6][6]) {
  const double r_2 = CUP_RADIUS * CUP_RADIUS;
  const Place p = place_of(pose);
  double first[3], in_frame[3][3], fixed[6][6];
  Sums sums;
  (void)patch, (void)frame;
  if (!(p.edge < (p.cos_tilt > RIM_COS ? 1.0 : p.begin))) return;
  sum_points(&p, FIRST, 0, &sums);
  value[0] = r_2 * sum_of(sums.area), value[1] = r_2 * sum_of(sums.push);
  area_slope(&p, slope[0]);
  turn_vector(&p, (const double[3]){sum_of(sums.rate[0]), sum_of(sums.rate[1]), 0.0}, r_2, slope[1]);
  turn_vector(&p, (const double[3]){sum_of(sums.force[0]), sum_of(sums.force[1]), 0.0}, CUP_RADIUS * r_2, first);
  for (int i = 0; i < 3; i++) for (int j = 0; j < 3; j++) in_frame[i][j] = sum_of(sums.slope[i][j]);
  to_fixed(&p, in_frame, fixed);
  for (int i = 0; i < 3; i++) {
    value[2 + i] = cup_centre[i] * value[1] + first[i];
    for (int j = 0; j < 3; j++) slope[2 + i][j] = cup_centre[i] * slope[1][j] + CUP_RADIUS * fixed[i][j];
  }
  value[5] = largest_depth(&p, slope[5]);
}
