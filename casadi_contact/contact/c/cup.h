/* A ball in a spherical cup: the formulas of contact/cup.py. e = (x, sqrt(1 - x^2) cos, sqrt(1 - x^2) sin)
 * about b, the way from the cup's centre to the ball's. POINTS is a multiple of BLOCK. */
#define BLOCKS (2 * POINTS / BLOCK) /* of points: whole circles, then arcs */
#define PI 3.141592653589793

typedef struct {
  double frame[3][3], b[3], length; /* frame[0] along b, frame[1] towards the pole */
  double cos_tilt, sin_tilt;        /* of b against the pole */
  double begin, edge;               /* x at which the rim begins to cut circles, and at the edge of contact */
} Place;

/* Products of e, integrated over an arc: those that are not zero, by their places (0, 1, 2). */
typedef struct {
  Lanes e_0, e_1, e_00, e_01, e_11, e_22;
  Lanes e_000, e_001, e_011, e_022, e_111, e_122;
} Moments;

INLINE double clipped(double x) { return bounded_by(x, -1.0, 1.0); }

INLINE Place place_of(const double *t) {
  Place p;
  double over[3], size, shift;
  for (int i = 0; i < 3; i++) p.b[i] = t[i] - cup_centre[i];
  p.length = larger(sqrt(dot3(p.b, p.b)), LEAST_MM);
  for (int i = 0; i < 3; i++) p.frame[0][i] = p.length > LEAST_MM ? p.b[i] / p.length : cup_pole[i];
  p.cos_tilt = clipped(dot3(p.frame[0], cup_pole));
  for (int i = 0; i < 3; i++) over[i] = cup_pole[i] - p.cos_tilt * p.frame[0][i];
  size = sqrt(dot3(over, over));
  if (!(size > LEAST_MM)) {
    shift = dot3(p.frame[0], cup_beside);
    for (int i = 0; i < 3; i++) over[i] = cup_beside[i] - shift * p.frame[0][i];
    size = sqrt(dot3(over, over));
  }
  for (int i = 0; i < 3; i++) p.frame[1][i] = over[i] / size;
  cross(p.frame[0], p.frame[1], p.frame[2]);
  p.sin_tilt = dot3(p.frame[1], cup_pole);
  p.begin = RIM_COS * p.cos_tilt + RIM_SIN * p.sin_tilt;
  p.edge = clipped((CUP_RADIUS * CUP_RADIUS + p.length * p.length - BALL_RADIUS * BALL_RADIUS) /
                   (2.0 * CUP_RADIUS * p.length));
  return p;
}

/* Half of the arc that the rim leaves of the circle at x. */
INLINE double arc_at(const Place *p, double x) {
  const double across = sqrt(larger(1.0 - x * x, 0.0)) * p->sin_tilt;
  return acos(clipped((RIM_COS - x * p->cos_tilt) / larger(across, LEAST_SINE)));
}

INLINE void points_of(const Place *p, Lanes x[BLOCKS], Lanes weight[BLOCKS], Lanes arc[BLOCKS]) {
  const double low = larger(p->edge, p->cos_tilt > RIM_COS ? p->begin : 1.0);
  const double upper = larger(p->edge, p->begin);
  const double half = 0.5 * (upper - larger(p->edge, RIM_COS * p->cos_tilt - RIM_SIN * p->sin_tilt));
  for (int i = 0; i < POINTS; i++) {
    const double cut = upper - half * (1.0 + arc_node[i]);
    x[i / BLOCK][i % BLOCK] = 0.5 * (1.0 + low) + 0.5 * (1.0 - low) * whole_node[i];
    weight[i / BLOCK][i % BLOCK] = 0.5 * (1.0 - low) * whole_weight[i];
    arc[i / BLOCK][i % BLOCK] = PI;
    x[(POINTS + i) / BLOCK][i % BLOCK] = cut;
    weight[(POINTS + i) / BLOCK][i % BLOCK] = half * arc_weight[i];
    arc[(POINTS + i) / BLOCK][i % BLOCK] = half > 0.0 ? arc_at(p, cut) : 0.0;
  }
}

INLINE Moments moments_of(Lanes x, Lanes arc, int order) {
  const Lanes square = larger_of(1.0 - x * x, all(0.0)), across = root(square);
  Lanes sine, cosine, cube;
  Moments m;
  for (int l = 0; l < BLOCK; l++) sine[l] = sin(arc[l]), cosine[l] = cos(arc[l]);
  m.e_0 = 2.0 * x * arc, m.e_1 = 2.0 * across * sine;
  if (order == VALUE) return m;
  m.e_00 = x * m.e_0, m.e_01 = x * m.e_1;
  m.e_11 = square * (arc + sine * cosine), m.e_22 = square * (arc - sine * cosine);
  if (order == FIRST) return m;
  cube = sine * sine * sine * (2.0 / 3.0);
  m.e_000 = x * m.e_00, m.e_001 = x * m.e_01, m.e_011 = x * m.e_11, m.e_022 = x * m.e_22;
  m.e_111 = square * across * (2.0 * sine - cube), m.e_122 = square * across * cube;
  return m;
}

/* Sums over the points, in the frame of b: area, pressure, force, derivatives, second ones of pull . force. */
typedef struct {
  Lanes area, push, rate[2], force[2], slope[3][3], curvature[3][3];
} Sums;

INLINE void add_slope(const Moments *m, Lanes scale, Lanes rise, Lanes lean, Lanes slope[3][3]) {
  slope[0][0] += scale * (rise * m->e_00 - lean * m->e_0);
  slope[0][1] += scale * rise * m->e_01;
  slope[1][0] += scale * (rise * m->e_01 - lean * m->e_1);
  slope[1][1] += scale * rise * m->e_11;
  slope[2][2] += scale * rise * m->e_22;
}

/* + integral of (pull . e) (ee e e^T + eb (e b^T + b e^T) + bb b b^T + unit I), b the first axis; upper triangle */
INLINE void add_curvature(const Moments *m, const double pull[3], Lanes ee, Lanes eb, Lanes bb, Lanes unit,
                          Lanes h[3][3]) {
  const Lanes one = pull[0] * m->e_0 + pull[1] * m->e_1;
  const Lanes two_0 = pull[0] * m->e_00 + pull[1] * m->e_01, two_1 = pull[0] * m->e_01 + pull[1] * m->e_11;
  const Lanes two_2 = pull[2] * m->e_22;
  h[0][0] += ee * (pull[0] * m->e_000 + pull[1] * m->e_001) + 2.0 * eb * two_0 + (bb + unit) * one;
  h[0][1] += ee * (pull[0] * m->e_001 + pull[1] * m->e_011) + eb * two_1;
  h[0][2] += ee * (pull[2] * m->e_022) + eb * two_2;
  h[1][1] += ee * (pull[0] * m->e_011 + pull[1] * m->e_111) + unit * one;
  h[1][2] += ee * (pull[2] * m->e_122);
  h[2][2] += ee * (pull[0] * m->e_022 + pull[1] * m->e_122) + unit * one;
}

/* Where the pressure's slope jumps, at the edge of contact: + p'(0)/|dd/dx| (pull . e) d_b d_b^T over the edge. */
INLINE void add_edge(const Place *p, const double pull[3], Lanes h[3][3]) {
  const double w = CUP_RADIUS - p->length * p->edge, rise = CUP_RADIUS / w, lean = p->length / w;
  const double arc = p->edge >= p->begin ? (p->cos_tilt > RIM_COS ? PI : 0.0) : arc_at(p, p->edge);
  const double jump = STIFFNESS_AT_ZERO / (p->length * rise);
  const Lanes first = {jump}; /* in one lane, the others zero */
  const Moments m = moments_of(all(p->edge), all(arc), SECOND);
  add_curvature(&m, pull, first * rise * rise, -first * rise * lean, first * lean * lean, all(0.0), h);
}

INLINE void sum_points(const Place *p, int order, const double pull[3], Sums *sums) {
  Lanes x[BLOCKS], weight[BLOCKS], arc[BLOCKS];
  const double under = BALL_RADIUS * BALL_RADIUS - p->length * p->length;
  memset(sums, 0, sizeof *sums);
  points_of(p, x, weight, arc);
  for (int i = 0; i < BLOCKS; i++) {
    const Lanes s = p->length * x[i], w = root(larger_of(under + s * s, all(LEAST_SINE))), inverse = 1.0 / w;
    const Lanes depth = s + w - CUP_RADIUS, force = weight[i] * pressure_at(depth);
    const Lanes rise = 1.0 + s * inverse, lean = p->length * inverse;
    const Moments m = moments_of(x[i], arc[i], order);
    sums->area += 2.0 * arc[i] * weight[i], sums->push += 2.0 * arc[i] * force;
    sums->force[0] += force * m.e_0, sums->force[1] += force * m.e_1;
    if (order == VALUE) continue;
    const Lanes mu = weight[i] * pressure_slope_at(depth);
    sums->rate[0] += mu * (rise * m.e_0 - 2.0 * arc[i] * lean), sums->rate[1] += mu * rise * m.e_1;
    add_slope(&m, mu, rise, lean, sums->slope);
    if (order == FIRST) continue;
    const Lanes nu = weight[i] * pressure_bend_at(depth), by_w = mu * inverse, by_cube = by_w * inverse * inverse;
    add_curvature(&m, pull, nu * rise * rise + by_w - by_cube * s * s, by_cube * s * p->length - nu * rise * lean,
                  nu * lean * lean - by_cube * p->length * p->length, -by_w, sums->curvature);
  }
  if (order == SECOND && p->edge > -1.0) add_edge(p, pull, sums->curvature);
}

/* Q^T m Q from the frame of b to the fixed axes, times the cup's radius squared */
INLINE void to_fixed(const Place *p, double m[3][3], double out[6][6]) {
  for (int i = 0; i < 3; i++) {
    for (int j = 0; j < 3; j++) {
      double sum = 0.0;
      for (int k = 0; k < 3; k++) for (int l = 0; l < 3; l++) sum += p->frame[k][i] * m[k][l] * p->frame[l][j];
      out[i][j] = CUP_RADIUS * CUP_RADIUS * sum;
    }
  }
}

/* e of the cup's point nearest to the ball; across the pole towards b: flat, of size `size` before it became a unit. */
INLINE int nearest_direction(const Place *p, double e[3], double flat[3], double *size) {
  const double along = dot3(p->b, cup_pole);
  const int inside = p->cos_tilt >= RIM_COS;
  for (int i = 0; i < 3; i++) flat[i] = p->b[i] - along * cup_pole[i];
  *size = larger(sqrt(dot3(flat, flat)), LEAST_MM);
  for (int i = 0; i < 3; i++) {
    flat[i] = *size > LEAST_MM ? flat[i] / *size : cup_beside[i];
    e[i] = inside ? p->frame[0][i] : RIM_COS * cup_pole[i] + RIM_SIN * flat[i];
  }
  return inside;
}

/* Distance to the cup within its rim: D - r with D^2 = R^2 + b^2 - 2 R s, s the most of e . b. */
INLINE void cup_gap(const Place *p, PatchLoads *out) {
  double flat[3], e[3], way[3], size, distance;
  const int inside = nearest_direction(p, e, flat, &size);
  for (int i = 0; i < 3; i++) way[i] = p->b[i] - CUP_RADIUS * e[i];
  distance = sqrt(dot3(way, way));
  out->gap = distance - BALL_RADIUS;
  for (int i = 0; i < 3; i++) out->gap_slope[i] = way[i] / distance;
  for (int i = 0; i < 3; i++) {
    for (int j = 0; j < 3; j++) {
      const double unit = i == j ? 1.0 : 0.0;
      const double turn = inside ? (unit - e[i] * e[j]) / p->length /* second derivatives of s */
                                 : RIM_SIN * (unit - cup_pole[i] * cup_pole[j] - flat[i] * flat[j]) / size;
      out->gap_curvature[i][j] = (unit - CUP_RADIUS * turn - out->gap_slope[i] * out->gap_slope[j]) / distance;
    }
  }
}

INLINE void loads_of_patch(int patch, const double *pose, const Frame *frame, int order, int with_gap,
                           const double *weights, PatchLoads *out) {
  const Place p = place_of(pose);
  const int touches = p.edge < (p.cos_tilt > RIM_COS ? 1.0 : p.begin);
  (void)patch, (void)frame;
  memset(out, 0, sizeof *out);
  out->apart = !touches;
  if (with_gap && (!touches || order == GAPS)) cup_gap(&p, out);
  if (touches && order != GAPS) {
    double pull[3] = {0.0}, of_frame[3][3];
    Sums sums;
    if (order == SECOND) { /* weights of the force, and of the torque C x F */
      double turned[3];
      cross(weights + 3, cup_centre, turned);
      for (int i = 0; i < 3; i++) for (int k = 0; k < 3; k++) pull[i] += p.frame[i][k] * (weights[k] + turned[k]);
    }
    sum_points(&p, order, pull, &sums);
    out->cut = p.edge < p.begin;
    for (int i = 0; i < 3; i++) {
      out->wrench[i] = CUP_RADIUS * CUP_RADIUS *
                       (p.frame[0][i] * sum_of(sums.force[0]) + p.frame[1][i] * sum_of(sums.force[1]));
    }
    cross(cup_centre, out->wrench, out->wrench + 3);
    if (order == FIRST) {
      for (int i = 0; i < 3; i++) for (int j = 0; j < 3; j++) of_frame[i][j] = sum_of(sums.slope[i][j]);
      to_fixed(&p, of_frame, out->stiffness);
      for (int j = 0; j < 3; j++) {
        const double column[3] = {out->stiffness[0][j], out->stiffness[1][j], out->stiffness[2][j]};
        double moment[3];
        cross(cup_centre, column, moment);
        for (int i = 0; i < 3; i++) out->stiffness[3 + i][j] = moment[i];
      }
    }
    if (order == SECOND) {
      for (int i = 0; i < 3; i++) {
        for (int j = 0; j < 3; j++) of_frame[i][j] = sum_of(sums.curvature[i < j ? i : j][i < j ? j : i]);
      }
      to_fixed(&p, of_frame, out->curvature);
    }
  }
}
