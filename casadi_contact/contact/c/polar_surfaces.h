/* Loads in chart axes and in the fixed body's; TURNED: the two differ. */

/* A twist or wrench into chart axes. */
INLINE void turn_twist(const double turn[3][3], const double x[6], double out[6]) {
  for (int i = 0; i < 6; i++) {
    const double *row = turn[i % 3], *part = x + (i < 3 ? 0 : 3);
    out[i] = row[0] * part[0] + row[1] * part[1] + row[2] * part[2];
  }
}

#if TURNED
/* A vector in chart axes, its components a stride apart, becomes that in the fixed body's. */
INLINE void turn_back_vector(const double turn[3][3], double *x, int stride) {
  const double old[3] = {x[0], x[stride], x[2 * stride]};
  for (int i = 0; i < 3; i++) x[i * stride] = turn[0][i] * old[0] + turn[1][i] * old[1] + turn[2][i] * old[2];
}

INLINE void turn_back_row(const double turn[3][3], double x[6]) {
  for (int i = 0; i < 6; i += 3) turn_back_vector(turn, x + i, 1);
}

/* Of a matrix the first six rows, and the first six columns: B^T h B with B = turn twice */
INLINE void turn_back_both(const double turn[3][3], double *h, int rows, int columns) {
  for (int i = 0; i < rows; i++) turn_back_row(turn, h + columns * i);
  for (int j = 0; j < columns; j++) {
    turn_back_vector(turn, h + j, columns), turn_back_vector(turn, h + 3 * columns + j, columns);
  }
}
#endif

/* Loads in chart axes become those in the fixed body's. */
INLINE void turn_back(const double turn[3][3], int order, PatchLoads *out) {
#if TURNED
  turn_back_row(turn, out->wrench);
  turn_back_row(turn, out->gap_slope);
  if (order == FIRST) turn_back_both(turn, out->stiffness[0], 6, 6);
  if (order == SECOND) {
    turn_back_both(turn, out->curvature[0], 6, 6);
    turn_back_both(turn, out->gap_curvature[0], 6, 6);
  }
#if MOVING
  if (order == FIRST) turn_back_both(turn, out->by_motion[0], 6, LOCALS);
  if (order == SECOND) {
    turn_back_row(turn, out->gradient);
    turn_back_both(turn, out->mixed[0], 6, LOCALS);
    turn_back_both(turn, out->local[0], LOCALS, LOCALS);
  }
#endif
#else
  (void)turn, (void)order, (void)out;
#endif
}

/* Two smooth surfaces with one spot of contact: the formulas of contact/polar/ray_hits.py, in chart axes.
 * TORUS: the fixed surface is a torus, else the plane y = 0. CURVED_RIM: |u| <= spread rho(v). */
typedef struct {
  double axis_x, axis_y, offset, tangent_x, tangent_y; /* the tangent ends the arc */
} Arc;

typedef struct {
  double offset, radius, height, rho_sign, w_sign; /* fixed torus */
  double u_low, u_high, v_low, v_high, spread;     /* rim */
  double z_0;
  double tube_radius, centre_z;
  double close_fit; /* 1 where a second spot is looked for, else 0 */
  double turn[3][3];
  Arc arc[ARCS];
} Surfaces;

/* The moving body's place in chart axes. */
typedef struct {
  double r[3][3], t[3];
#if MOVING
  double motion[11];
#endif
} Place;

typedef struct {
  Lanes y, n_x, n_z, length; /* of the fixed point; N = (n_x, 1, n_z) */
  Lanes g, step;             /* distance from the body, depth in units of |N| */
  Lanes x[3], gradient[3], across[3], along[3], kappa; /* at the end on the body, where asked for */
  Lanes arc;
} Ray;

INLINE void fixed_point(const Surfaces *s, Lanes u, Lanes v, Ray *ray) {
#if TORUS
  const double least = LEAST_UPRIGHT * s->radius;
  const Lanes tube = root(larger_of(s->radius * s->radius - v * v, all(least * least)));
  const Lanes rho = s->offset + s->rho_sign * tube, square = rho * rho;
  const Lanes w = root(larger_of(square - u * u, LEAST_UPRIGHT * LEAST_UPRIGHT * square)), inverse = 1.0 / (tube * w);
  ray->y = s->height + s->w_sign * w;
  ray->n_x = s->w_sign * u * tube * inverse;
  ray->n_z = s->w_sign * s->rho_sign * rho * v * inverse;
  ray->length = s->radius * rho * inverse;
#else
  (void)s, (void)u;
  ray->y = 0.0 * v, ray->n_x = ray->y, ray->n_z = ray->y, ray->length = 1.0 + ray->y;
#endif
}

INLINE void to_body(const Place *p, const Lanes x[3], Lanes out[3]) {
  for (int i = 0; i < 3; i++) out[i] = p->r[0][i] * x[0] + p->r[1][i] * x[1] + p->r[2][i] * x[2];
}

INLINE void to_chart(const Place *p, Lanes x, Lanes y, Lanes z, Lanes out[3]) {
  for (int i = 0; i < 3; i++) out[i] = p->r[i][0] * x + p->r[i][1] * y + p->r[i][2] * z;
}

enum { DEPTH_ONLY, TO_END, AT_START };
#define OWN_ARC (-1)

/* The ray from (u, v) along -N: one Newton step of g(c - step N) = 0 and the part of g's curvature along the ray. What
 * else: at its end on the body (TO_END), or at the fixed point itself (AT_START), the gradient of g, its directions of
 * curvature and the curvature along the arc. On the torus of the arc `on`, also beyond its ends, or of each ray's own
 * (OWN_ARC). */
INLINE void cast(const Surfaces *s, const Place *p, Lanes u, Lanes v, int on, int what, Ray *ray) {
  const Arc *last = s->arc + (on < 0 ? ARCS - 1 : on);
  Lanes axis_x = last->axis_x + 0.0 * u, axis_y = last->axis_y + 0.0 * u, offset = last->offset + 0.0 * u;
  Lanes q[3], m[3], x, y, z, rho, out, distance, inverse, a, b, m_r, m_t, slope, bend, bent;
  fixed_point(s, u, v, ray);
  {
    const Lanes from[3] = {u - p->t[0], ray->y - p->t[1], v + s->z_0 - p->t[2]}, normal[3] = {ray->n_x, 1.0 + 0.0 * u, ray->n_z};
    to_body(p, from, q);
    to_body(p, normal, m);
  }
  if (what != DEPTH_ONLY) ray->arc = (on < 0 ? ARCS - 1 : on) + 0.0 * u;
  for (int k = ARCS - 2; on < 0 && k >= 0; k--) {
    const Arc *arc = s->arc + k;
    const Mask past = (q[0] - arc->axis_x) * arc->tangent_x + (q[1] - arc->axis_y) * arc->tangent_y > 0.0;
    axis_x = pick(past, axis_x, all(arc->axis_x));
    axis_y = pick(past, axis_y, all(arc->axis_y));
    offset = pick(past, offset, all(arc->offset));
    if (what != DEPTH_ONLY) ray->arc = pick(past, ray->arc, all(k));
  }
  x = q[0] - axis_x, y = q[1] - axis_y, z = q[2] - s->centre_z;
  rho = larger_of(root(x * x + y * y), all(LEAST_LENGTH));
  out = rho - offset;
  distance = larger_of(root(out * out + z * z), all(LEAST_LENGTH));
  inverse = 1.0 / (rho * distance);
  a = out * rho * inverse, b = z * rho * inverse; /* gradient along the radius and along z */
  m_r = (x * m[0] + y * m[1]) * distance * inverse;
  m_t = (x * m[1] - y * m[0]) * distance * inverse;
  slope = smaller_of(a * m_r + b * m[2], STEEPEST * ray->length);
  bent = a * m[2] - b * m_r;
  bend = rho * inverse * bent * bent + a * distance * inverse * m_t * m_t;
  ray->g = distance - s->tube_radius;
  if (what == AT_START) {
    ray->step = 0.0 * u;
  } else {
    const Lanes by_slope = 1.0 / slope;
    ray->step = ray->g * by_slope;
    ray->step += larger_of(0.5 * ray->step * bend * by_slope, all(MOST_SHORTER)) * ray->step;
  }
  if (what == TO_END) {
    x -= ray->step * m[0], y -= ray->step * m[1], z -= ray->step * m[2];
    rho = larger_of(root(x * x + y * y), all(LEAST_LENGTH));
    out = rho - offset;
    distance = larger_of(root(out * out + z * z), all(LEAST_LENGTH));
    inverse = 1.0 / (rho * distance);
    a = out * rho * inverse, b = z * rho * inverse;
  }
  if (what != DEPTH_ONLY) {
    const Lanes e_x = x * distance * inverse, e_y = y * distance * inverse;
    ray->kappa = a * distance * inverse;
    to_chart(p, a * e_x, a * e_y, b, ray->gradient);
    to_chart(p, -b * e_x, -b * e_y, a, ray->across);
    to_chart(p, -e_y, e_x, 0.0 * u, ray->along);
    ray->x[0] = u - ray->step * ray->n_x;
    ray->x[1] = ray->y - ray->step;
    ray->x[2] = v + s->z_0 - ray->step * ray->n_z;
  }
}

/* G.N at the end of a ray, negative */
INLINE Lanes steepness(const Ray *ray) {
  return ray->gradient[0] * ray->n_x + ray->gradient[1] + ray->gradient[2] * ray->n_z;
}

/* r > 0 at which depth + slope r - curvature r^2/2 = 0 */
INLINE Lanes edge_of(Lanes depth, Lanes slope, Lanes curvature) {
  const Lanes k = larger_of(curvature, all(LEAST_CURVATURE));
  return (slope + root(slope * slope + 2.0 * k * depth)) / k;
}

/* One ray: depth at (u, v), its slopes, and the curvatures (uu, uv, vv) of the moving surface relative to the fixed
 * one; the end on the body. AT_START: all of -g instead of the depth. */
typedef struct {
  double u, v, depth, slope[2], curvature[3];
  double tangent[2][3], end[3], along[3], kappa;
  int arc;
} Spot;

INLINE double form(const double a[3], const double b[3], const double across[3], double k_1, const double along[3],
                   double k_2) {
  return k_1 * dot3(across, a) * dot3(across, b) + k_2 * dot3(along, a) * dot3(along, b);
}

INLINE Spot spot_at(const Surfaces *s, const Place *p, double u, double v, int what) {
  Spot spot;
  Ray ray;
  double gradient[3], across[3], inverse, k_1, (*tau)[3] = spot.tangent;
  cast(s, p, all(u), all(v), OWN_ARC, what, &ray);
  for (int i = 0; i < 3; i++) {
    spot.end[i] = ray.x[i][0], spot.along[i] = ray.along[i][0];
    gradient[i] = ray.gradient[i][0], across[i] = ray.across[i][0];
  }
  spot.u = u, spot.v = v, spot.depth = what == AT_START ? -ray.g[0] : (ray.step * ray.length)[0];
  spot.kappa = ray.kappa[0], spot.arc = (int)ray.arc[0];
  tau[0][0] = 1.0, tau[0][1] = -ray.n_x[0], tau[0][2] = 0.0;
  tau[1][0] = 0.0, tau[1][1] = -ray.n_z[0], tau[1][2] = 1.0;
  inverse = what == AT_START ? -1.0 : (ray.length / steepness(&ray))[0];
  k_1 = 1.0 / (s->tube_radius + (what == AT_START ? ray.g[0] : 0.0));
  for (int i = 0; i < 2; i++) spot.slope[i] = dot3(tau[i], gradient) * inverse;
  for (int i = 0, k = 0; i < 2; i++) {
    for (int j = i; j < 2; j++, k++) spot.curvature[k] = form(tau[i], tau[j], across, k_1, spot.along, spot.kappa);
  }
#if TORUS
  {
    const double y = ray.y[0] - s->height, rho = sqrt(u * u + y * y), out = rho - s->offset;
    const double bend = what == AT_START ? -ray.length[0] * gradient[1] : 1.0, fixed_k_1 = 1.0 / s->radius;
    const double a = out * fixed_k_1, b = v * fixed_k_1, e_x = u / rho, e_y = y / rho, k_2 = a / rho;
    const double across_fixed[3] = {-b * e_x, -b * e_y, a}, along_fixed[3] = {-e_y, e_x, 0.0};
    for (int i = 0, k = 0; i < 2; i++) {
      if (what != AT_START) {
        spot.slope[i] += spot.depth * inverse * form(tau[i], gradient, across_fixed, fixed_k_1, along_fixed, k_2);
      }
      for (int j = i; j < 2; j++, k++) {
        spot.curvature[k] -= bend * form(tau[i], tau[j], across_fixed, fixed_k_1, along_fixed, k_2);
      }
    }
  }
#endif
  return spot;
}
