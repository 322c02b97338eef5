/* The rim of a patch and the point nearest to the body: the formulas of contact/polar/rim.py and nearest.py. */

INLINE double bounded_by(double x, double low, double high) { return x < low ? low : (x > high ? high : x); }

/* u = w s(v): in (w, v) the rim is a box */
INLINE void box_of(const Surfaces *s, double low[2], double high[2]) {
  low[0] = CURVED_RIM ? -s->spread : s->u_low, high[0] = CURVED_RIM ? s->spread : s->u_high;
  low[1] = s->v_low, high[1] = s->v_high;
}

/* s(v) with its first and second derivative */
INLINE void stretch_of(const Surfaces *s, double v, double stretch[3]) {
#if CURVED_RIM
  const double tube = sqrt(s->radius * s->radius - v * v);
  stretch[0] = s->offset + s->rho_sign * tube;
  stretch[1] = -s->rho_sign * v / tube;
  stretch[2] = -s->rho_sign * s->radius * s->radius / (tube * tube * tube);
#else
  (void)s, (void)v;
  stretch[0] = 1.0, stretch[1] = stretch[2] = 0.0;
#endif
}

INLINE void u_range(const Surfaces *s, double v, double *low, double *high) {
#if CURVED_RIM
  *high = s->spread * (s->offset + s->rho_sign * sqrt(s->radius * s->radius - v * v));
  *low = -*high;
#else
  (void)v;
  *low = s->u_low, *high = s->u_high;
#endif
}

INLINE void within(const Surfaces *s, double *u, double *v) {
  double low, high;
  *v = bounded_by(*v, s->v_low, s->v_high);
  u_range(s, *v, &low, &high);
  *u = bounded_by(*u, low, high);
}

INLINE int is_within(const Surfaces *s, double u, double v) {
  double low, high;
  u_range(s, v, &low, &high);
  return v >= s->v_low && v <= s->v_high && u >= low && u <= high;
}

/* A spot in the rim's coordinates (w, v): depth, slopes, minus the second derivatives ww, wv, vv; tangents. */
typedef struct {
  double x[2], stretch, slope[2], curvature[3], tangent[2][3];
} Charted;

INLINE Charted charted(const Surfaces *s, const Spot *spot) {
  Charted c;
  const double *k = spot->curvature, b_u = spot->slope[0];
  double stretch[3], lean, k_uv;
  stretch_of(s, spot->v, stretch);
  c.x[0] = spot->u / stretch[0], c.x[1] = spot->v, c.stretch = stretch[0];
  lean = c.x[0] * stretch[1];
  k_uv = k[1] + lean * k[0];
  c.slope[0] = stretch[0] * b_u, c.slope[1] = spot->slope[1] + lean * b_u;
  c.curvature[0] = stretch[0] * stretch[0] * k[0];
  c.curvature[1] = stretch[0] * k_uv - stretch[1] * b_u;
  c.curvature[2] = k[2] + lean * (k[1] + k_uv) - c.x[0] * stretch[2] * b_u;
  for (int i = 0; i < 3; i++) {
    c.tangent[0][i] = stretch[0] * spot->tangent[0][i];
    c.tangent[1][i] = spot->tangent[1][i] + lean * spot->tangent[0][i];
  }
  return c;
}

/* The point of the patch where the depth (AT_START: -g) has the maximum that is uphill from a spot. */
INLINE Spot highest(const Surfaces *s, const Place *p, Spot spot, int what) {
  double low[2], high[2], trust = 1.0;
  box_of(s, low, high);
  for (int i = 0; i < SEARCH_STEPS; i++) {
    const Charted at = charted(s, &spot);
    const double k[2] = {larger(at.curvature[0], LEAST_CURVATURE * at.stretch * at.stretch),
                         larger(at.curvature[2], LEAST_CURVATURE)};
    double step[2] = {0.0, 0.0}, part = 0.0, stretch[3];
    Spot tried;
    for (int j = 0; j < 2 * SWEEPS; j++) {
      const int e = j % 2;
      const double reach = trust * (high[e] - low[e]);
      step[e] = bounded_by((at.slope[e] - at.curvature[1] * step[1 - e]) / k[e], larger(low[e] - at.x[e], -reach),
                           smaller(high[e] - at.x[e], reach));
    }
    for (int e = 0; e < 2; e++) part = larger(part, fabs(step[e]) / (high[e] - low[e]));
    stretch_of(s, at.x[1] + step[1], stretch);
    tried = spot_at(s, p, (at.x[0] + step[0]) * stretch[0], at.x[1] + step[1], what);
    if (part < LAST_STEP) return tried;
    if (tried.depth > spot.depth) {
      spot = tried;
      trust *= 2.0;
    } else {
      trust = 0.25 * part;
    }
  }
  return spot;
}

/* The point of the patch nearest to the body, from the lowest of a point and the starts; where the body lies nearly as
 * flat as the patch, from each row of starts. */
FUNCTION Spot nearest_to(const Surfaces *s, const Place *p, double u, double v) {
  Spot best = spot_at(s, p, u, v, AT_START);
  double low[2], high[2], least[STARTS], along[STARTS], across[STARTS], gauss;
  int lowest = 0;
  box_of(s, low, high);
  for (int row = 0; row < STARTS; row++) {
    double stretch[3];
    across[row] = low[1] + (high[1] - low[1]) * starts[row], least[row] = 1e300, along[row] = u;
    stretch_of(s, across[row], stretch);
    for (int i = 0; i < STARTS; i += BLOCK) {
      const Lanes places = (low[0] + (high[0] - low[0]) * lanes_at(starts + i)) * stretch[0];
      Ray ray;
      cast(s, p, places, all(across[row]), OWN_ARC, AT_START, &ray);
      for (int l = 0; l < BLOCK && i + l < STARTS; l++) {
        if (ray.g[l] < least[row]) least[row] = ray.g[l], along[row] = places[l];
      }
    }
    if (least[row] < least[lowest]) lowest = row;
  }
  if (least[lowest] < -best.depth) best = spot_at(s, p, along[lowest], across[lowest], AT_START);
  best = highest(s, p, best, AT_START);
  gauss = best.curvature[0] * best.curvature[2] - best.curvature[1] * best.curvature[1];
  if (best.curvature[0] > 0.0 && gauss > SINGLE * best.kappa / (s->tube_radius - best.depth)) return best;
  for (int row = 0; row < STARTS; row++) {
    const Spot other = highest(s, p, spot_at(s, p, along[row], across[row], AT_START), AT_START);
    if (other.depth > best.depth) best = other;
  }
  return best;
}

/* The deepest point along the rays: at the rim it is not the nearest one, from which the search for it runs. */
FUNCTION Spot deepest_within(const Surfaces *s, const Place *p, double u, double v) {
  const Spot near = nearest_to(s, p, u, v);
  return highest(s, p, spot_at(s, p, near.u, near.v, TO_END), TO_END);
}
